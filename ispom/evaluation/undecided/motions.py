"""Which motion would decide more: a short motion is added to the scene, and the points are observed again during it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, so3_exp, so3_log
from ispom.types import Rig

from ..doctor.hypothesis import Change
from ..doctor.scene import CAMERAS, Observations, Scene, predicted
from .weakest import Decided, decided

TURN_DEG = 15.0
STEP_SHARE = 0.1
"""Length of a step, of the median distance of the points."""
VIEWS = 4
"""Poses on the way."""
MOTIONS: Mapping[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "pan": ((0, 1, 0), (0, 0, 0)),
    "tilt": ((1, 0, 0), (0, 0, 0)),
    "roll": ((0, 0, 1), (0, 0, 0)),
    "sideways": ((0, 0, 0), (1, 0, 0)),
    "up": ((0, 0, 0), (0, -1, 0)),
    "forwards": ((0, 0, 0), (0, 0, 1)),
}
"""By name: the axis of the turn and the direction of the step, in the rig's axes: x right, y down, z forward."""


@dataclass(frozen=True)
class Moved:
    """How the camera moved in a stretch."""

    turned_deg: float
    """Largest angle between two of its poses, and"""
    axis: Array
    """(3,) about which, in its own axes; zeros where it did not turn."""
    distance: float
    """Longest distance between two of its poses, over the median distance of the points, and"""
    direction: Array
    """(3,) in which, in its own axes; zeros where it rested."""


def motion_of(scene: Scene) -> Moved:
    """Returns how the rig moved, in its own axes at the first of the two poses that differ most."""
    turns = so3_log(np.swapaxes(scene.rotations[:, None], 2, 3) @ scene.rotations[None])
    steps = np.einsum("aji,abj->abi", scene.rotations, scene.positions[None] - scene.positions[:, None])
    turn, step = _longest(turns), _longest(steps)
    depth = median_distance(scene)
    angle, length = float(np.linalg.norm(turn)), float(np.linalg.norm(step))
    return Moved(
        float(np.degrees(angle)), turn / max(angle, 1e-12), length / max(depth, 1e-12), step / max(length, 1e-12)
    )


def with_motion(scene: Scene, rig: Rig, seen: Observations, name: str, noise_px: float) -> Decided:
    """Returns what would be decided if one of MOTIONS followed the last pose.

    The points of the last pose are observed during the motion while they stay in the image. Their errors of `noise_px`
    were drawn once.
    """
    axis, way = (np.array(each, float) for each in MOTIONS[name])
    shares = np.arange(1, VIEWS + 1) / VIEWS
    last = scene.rotations[-1]
    rotations = last @ so3_exp(np.radians(TURN_DEG) * shares[:, None] * axis)
    positions = scene.positions[-1] + STEP_SHARE * median_distance(scene) * shares[:, None] * (last @ way)
    interval = float(np.diff(scene.times_s).mean())
    times_s = scene.times_s[-1] + interval * np.arange(1, VIEWS + 1)
    longer = replace(
        scene,
        times_s=np.concatenate([scene.times_s, times_s]),
        rotations=np.concatenate([scene.rotations, rotations]),
        positions=np.concatenate([scene.positions, positions]),
    )
    live = np.unique(seen.point[seen.time_s >= scene.times_s[-1] - interval])
    cameras = [CAMERAS.index(name) for name in CAMERAS if (seen.camera == CAMERAS.index(name)).any()]
    more = looked_at(longer, rig, cameras, live, times_s, noise_px)
    parts = ((getattr(seen, n), getattr(more, n)) for n in ("camera", "time_s", "point", "uv"))
    return decided(longer, rig, Observations(*(np.concatenate(part) for part in parts)))


def looked_at(
    scene: Scene,
    rig: Rig,
    cameras: list[int],
    points: NDArray[np.int64],
    times_s: Array,
    noise_px: float,
    seed: int = 0,
) -> Observations:
    """Returns observations of these points at these times in these CAMERAS, where they are in the image, with normally
    distributed errors."""
    camera, time_s, point = (each.ravel() for each in np.meshgrid(cameras, times_s, points, indexing="ij"))
    asked = Observations(camera.astype(int), time_s, point.astype(int), np.zeros((len(camera), 2)))
    uv = -predicted(scene, rig, Change(), asked, False).residuals
    sizes = np.array([_size(rig, name) for name in CAMERAS])[asked.camera]
    inside = np.asarray(((uv >= 0) & (uv <= sizes - 1)).all(axis=1), bool)  # not where the camera cannot see
    noise = np.random.default_rng(seed).normal(0, noise_px, uv.shape)
    return replace(asked, uv=uv + noise).select(inside)


def median_distance(scene: Scene) -> float:
    """Returns the median distance of the points from the middle of the path."""
    return float(np.median(np.linalg.norm(scene.points - np.median(scene.positions, axis=0), axis=1)))


def _longest(vectors: Array) -> Array:
    flat = vectors.reshape(-1, 3)
    return flat[np.linalg.norm(flat, axis=1).argmax()]


def _size(rig: Rig, name: str) -> tuple[int, int]:
    if name not in rig.cameras:
        return 0, 0
    camera = rig.camera(name)
    return camera.width, camera.height
