"""The panorama of a run: its images, warped by their orientations into one image."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.rig import read_rig
from ispom.reconstruction.panorama import equirectangular, spaced
from ispom.types import Image, Sequence, Trajectory, main_image

from ...engine.run_folder.run_file import read_run_file
from ...session.review.stored import stored_source

APART_DEG, MOST = 4.0, 200
"""Least difference of the orientations of the images that are used, and their largest number."""


def panorama_png(run: Path, trajectory: Trajectory) -> tuple[bytes, str]:
    """Returns a PNG and what it shows. Raises InputError where the run's images are no longer there, or none has a
    pose."""
    rig, sequence = read_rig(run / "rig.yaml"), _images(run)
    indices = _indices(sequence, trajectory)
    if not len(indices):
        raise InputError(f"{run}: no image has a pose: give a run of a video or of pairs with poses")
    name = {"video": "video", "stereo": "left"}[sequence.kinds[indices[0]]]
    frame_from_camera = rig.rig_from(trajectory.frame).inverse() @ rig.rig_from(name)
    at = np.searchsorted(trajectory.times_ns, sequence.times_ns[indices])
    rotations = trajectory.rotations[at] @ frame_from_camera.rotation
    rotations = rotations[0].T @ rotations  # the first image in the middle
    chosen = spaced(rotations, np.radians(APART_DEG), MOST)
    panorama = equirectangular(_views(sequence, indices[chosen], rotations[chosen]), rig.camera(name))
    if not panorama.size:
        raise InputError(f"{run}: its images cover nothing of the panorama")
    bgr = cv2.cvtColor(panorama, cv2.COLOR_RGB2BGR)
    height, width = panorama.shape[:2]
    return cv2.imencode(".png", bgr)[1].tobytes(), f"{len(chosen)} images in a panorama of {width} x {height} pixels"


def _images(run: Path) -> Sequence:
    """Opens the source of the run again; no camera and no address is opened."""
    return stored_source(run, read_run_file(run), cure="a panorama needs the images of the run: run again").opened()


def _indices(sequence: Sequence, trajectory: Trajectory) -> np.ndarray:
    """Returns the frames that have a pose: of the video where there is any, else pairs."""
    posed = np.isin(sequence.times_ns, trajectory.times_ns)
    for kind in ("video", "stereo"):
        found = np.flatnonzero(posed & (np.array(sequence.kinds) == kind))
        if len(found):
            return found
    return np.zeros(0, np.int64)


def _views(sequence: Sequence, indices: np.ndarray, rotations: Array) -> Iterator[tuple[Image, Array]]:
    for i, rotation in zip(indices.tolist(), rotations, strict=True):
        shown = main_image(sequence[i])
        if shown is not None:
            yield shown[1], rotation
