"""The rigid scene that the doctor makes of its tracks: poses of the rig, points, and their observations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, so3_exp, so3_log
from ispom.types import Rig

from .hypothesis import Change

CAMERAS = ("video", "left", "right")


@dataclass(frozen=True, eq=False)
class Observations:
    """N observations."""

    camera: NDArray[np.int64]
    """(N,) place in CAMERAS."""
    time_s: Array
    """(N,) of the frame."""
    point: NDArray[np.int64]
    """(N,)"""
    uv: Array
    """(N, 2)"""

    def __len__(self) -> int:
        return len(self.uv)

    def select(self, chosen: NDArray[np.bool_]) -> Observations:
        """Returns some of them."""
        return Observations(self.camera[chosen], self.time_s[chosen], self.point[chosen], self.uv[chosen])


@dataclass(frozen=True, eq=False)
class Scene:
    """K poses world_from_rig, between which the rig moves evenly, and P points."""

    times_s: Array
    """(K,)"""
    rotations: Array
    """(K, 3, 3)"""
    positions: Array
    """(K, 3)"""
    points: Array
    """(P, 3)"""
    known: bool = False
    """Whether the poses are known, and no adjustment moves them."""

    def moved(self, twists: Array, points: Array) -> Scene:
        """Returns it with the poses changed by (K, 6), rotation in the rig's axes first, and the points by (P, 3)."""
        rotations = self.rotations @ so3_exp(twists[:, :3])
        return replace(self, rotations=rotations, positions=self.positions + twists[:, 3:], points=self.points + points)


@dataclass(frozen=True, eq=False)
class Predicted:
    """Reprojection errors of a scene, with their derivatives."""

    residuals: Array
    """(N, 2) [px], observed less predicted; NaN where the camera cannot see the point."""
    knot: NDArray[np.int64]
    """(N,) the pose before; the one after is the next."""
    weight: Array
    """(N,) of the one after."""
    by_twist: Array
    """(N, 2, 6) of the prediction, by a change of the pose at this time."""
    by_point: Array
    """(N, 2, 3)"""


def predicted(scene: Scene, rig: Rig, change: Change, seen: Observations, derivatives: bool = True) -> Predicted:
    """Projects the points into the cameras of the changed rig, each row at its own time."""
    changed = change.of_rig(rig)
    clock_s = change.perturbation.clock_ms * 1e-3
    time_s = seen.time_s.copy()
    for c, name in enumerate(CAMERAS):
        mine = seen.camera == c
        if not mine.any():
            continue
        camera = changed.camera(name)
        time_s[mine] += camera.line_delay_s * (seen.uv[mine, 1] - (camera.height - 1) / 2)
        if name != "video":  # the poses are at the video's own times, between which the motion is not quite even
            time_s[mine] -= clock_s
    knot = np.clip(np.searchsorted(scene.times_s, time_s, side="right") - 1, 0, len(scene.times_s) - 2)
    span = scene.times_s[knot + 1] - scene.times_s[knot]
    weight = (time_s - scene.times_s[knot]) / span
    between = so3_log(np.swapaxes(scene.rotations[:-1], 1, 2) @ scene.rotations[1:])
    rotation = scene.rotations[knot] @ so3_exp(weight[:, None] * between[knot])
    position = scene.positions[knot] + weight[:, None] * (scene.positions[knot + 1] - scene.positions[knot])
    in_rig = np.einsum("nji,nj->ni", rotation, scene.points[seen.point] - position)
    residuals, count = np.full((len(seen), 2), np.nan), len(seen) if derivatives else 0
    by_twist, by_point = np.zeros((count, 2, 6)), np.zeros((count, 2, 3))
    for c, name in enumerate(CAMERAS):
        mine = np.flatnonzero(seen.camera == c)
        if not len(mine):
            continue
        camera, camera_from_rig = changed.camera(name), changed.rig_from(name).inverse()
        in_camera = camera_from_rig.apply(in_rig[mine])
        residuals[mine] = seen.uv[mine] - camera.project(in_camera)
        if derivatives:
            by_rig = camera.project_jacobian(in_camera) @ camera_from_rig.rotation
            by_world = by_rig @ np.swapaxes(rotation[mine], 1, 2)
            by_twist[mine, :, :3] = np.cross(by_rig, in_rig[mine][:, None, :])
            by_twist[mine, :, 3:], by_point[mine] = -by_world, by_world
    return Predicted(residuals, knot, weight, by_twist, by_point)
