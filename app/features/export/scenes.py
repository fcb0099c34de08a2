"""The formats of `ispom export` that have cameras, images and points together: COLMAP, nerfstudio, MCAP; and the
settings of other programs for the rig of a run."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np

from ispom.errors import InputError, UnreadableImage, printable
from ispom.io.calibrations.files import rig_files
from ispom.io.maps import SceneMap, read_maps
from ispom.io.mcap import mcap_bytes
from ispom.io.nerfstudio import transforms_text
from ispom.io.orbslam import orbslam_text
from ispom.io.rig import read_rig
from ispom.types import Camera, Frame, Image, Sequence, Trajectory

from ...engine.run_folder.results import in_frame
from ...engine.run_folder.run_file import read_run_file
from ...session.review.stored import stored_source

Files = dict[str, str | bytes]
USUAL_HZ = 30.0


def scene_of(run: Path, method: str) -> tuple[SceneMap, Camera]:
    """The map of a method and the camera of its keyframes. Raises InputError where the run has none."""
    scene, rig = read_maps(run / "landmarks.npz").get(method), read_rig(run / "rig.yaml")
    if scene is None or getattr(rig, scene.key_frames.frame) is None:
        raise InputError(f"{run} has no points of {method}, or not their camera: run again")
    return scene, rig.camera(scene.key_frames.frame)


def nerfstudio_files(run: Path, method: str) -> tuple[Files, str]:
    """transforms.json of the keyframes, and their images where the run's source is still there."""
    scene, camera = scene_of(run, method)
    keys = scene.key_frames
    text = transforms_text(camera, keys, lambda time_ns: f"images/{time_ns}.png")
    files: Files = {f"{method}/transforms.json": text}
    for time_ns, image in _key_images(run, keys):
        bgr = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        files[f"{method}/images/{time_ns}.png"] = cv2.imencode(".png", bgr)[1].tobytes()
    return files, f"{len(keys)} keyframes, {len(files) - 1} images"


def mcap_files(run: Path, method: str, trajectory: Trajectory, unit_m: float | None) -> tuple[Files, str]:
    """All poses, the points, and the images of the keyframes where the run's source is still there."""
    scene, camera = scene_of(run, method)
    poses = in_frame(trajectory, read_rig(run / "rig.yaml"), scene.key_frames.frame, unit_m)
    images = [*_key_images(run, scene.key_frames)]
    content = mcap_bytes(camera, poses, scene.landmarks, images)
    return {f"{method}.mcap": content}, f"{len(poses)} poses, {len(scene.landmarks)} points, {len(images)} images"


def settings_files(run: Path, form: str, trajectory: Trajectory) -> tuple[Files, str]:
    """The rig of the run as another program's file."""
    rig = read_rig(run / "rig.yaml")
    if form == "kalibr":
        return {**rig_files(rig, "kalibr")}, "the cameras of the run"
    steps = np.diff(trajectory.times_ns)
    rate_hz = 1e9 / float(np.median(steps)) if len(steps) else USUAL_HZ
    return {"orbslam3.yaml": orbslam_text(rig, rate_hz)}, "the rectified pair, or else the camera, of the run"


def _key_images(run: Path, keys: Trajectory) -> Iterator[tuple[int, Image]]:
    """Yields the images of keyframes in the run's source; none where that is gone, which is said."""
    try:
        sequence = stored_source(run, read_run_file(run), cure="without images").opened()
    except InputError as fault:
        sys.stdout.write(printable(f"no images are written: {fault.args[0]}\n"))
        return
    for i in np.flatnonzero(np.isin(sequence.times_ns, keys.times_ns)).tolist():
        image = _image(sequence, i, keys.frame)
        if image is not None:
            yield int(sequence.times_ns[i]), image


def _image(sequence: Sequence, i: int, camera: str) -> Image | None:
    with suppress(UnreadableImage):
        frame = sequence[i]
        return frame.images.get(camera) if isinstance(frame, Frame) else None
    return None
