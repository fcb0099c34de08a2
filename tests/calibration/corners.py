"""Corners without pictures: projections with noise, for the tests of what is solved from them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.detection.detection import Detection
from ispom.calibration.result import Views
from ispom.calibration.targets.target import Target
from ispom.geometry import Array, Pose
from ispom.types import Camera

NOISE_PX = 0.2


def seen_points(
    camera: Camera, camera_from_board: Pose, xyz_in_board: Array, noise_px: float, rng: np.random.Generator
) -> tuple[NDArray[np.intp], Array]:
    """Indices (N,) and pixels (N, 2) with Gaussian noise of the points that are in the image."""
    uv = camera.project(camera_from_board.apply(xyz_in_board))
    uv = uv + noise_px * rng.standard_normal(uv.shape)
    inside = (uv >= 0).all(1) & (uv <= (camera.width - 1, camera.height - 1)).all(1)
    ids = np.flatnonzero(inside)
    return ids, uv[ids]


def seen_by(
    target: Target, camera: Camera, poses: list[Pose], rng: np.random.Generator, noise_px: float = NOISE_PX
) -> list[Detection]:
    """A detection for each camera_from_board."""
    out = []
    for pose in poses:
        ids, uv = seen_points(camera, pose, target.xyz_in_board, noise_px, rng)
        found = Detection.of(ids, uv, np.full(len(ids), max(noise_px, 0.01)))
        out.append(found if len(ids) >= 8 else Detection(reason="not in the image"))
    return out


def views_of(name: str, camera: Camera, detections: list[Detection]) -> Views:
    images = tuple(f"{i:03d}.png" for i in range(len(detections)))
    return Views(name, (camera.width, camera.height), images, tuple(detections))
