"""Where a frame is: against the map, beside a pure turn, and how sure that is."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ispom.estimators.keyframes import Frame
from ispom.estimators.modern.mono_map import Map
from ispom.estimators.modern.mono_start import MIN_POINTS
from ispom.geometry import Array, Pose, skew
from ispom.solvers.motion_only import Motion, adjust_motion
from ispom.solvers.resection import resect
from ispom.solvers.rotation import dominant_rotation, median_displacement
from ispom.types import Decision

SPOT_DEG = 0.5
"""Tracks that a turn alone explains to within this (median) show no travel."""


def locate(xyz: Array, x: Array, world_from_guess: Pose, limit: float) -> Motion | None:
    """From the predicted pose, or, where that leads nowhere, by P3P in RANSAC. `limit` in normalised units."""
    found = adjust_motion(xyz, x, world_from_guess.inverse(), limit)
    if found is None or found.inliers.mean() < 0.6:
        again = resect(xyz, x, limit)
        other = None if again is None else adjust_motion(xyz, x, again.camera_from_world, limit)
        if other is not None and (found is None or other.inliers.sum() > found.inliers.sum()):
            found = other
    return found


def turned(before: Frame, frame: Frame, sigma: float) -> tuple[Decision, Pose] | None:
    """Where enough tracks moved as a pure turn moves them: that test, and the last place with the new orientation."""
    ids = np.intersect1d(before.ids, frame.ids, assume_unique=True)
    if len(ids) < MIN_POINTS or before.world_from_camera is None:
        return None
    last, x1, x2 = before.world_from_camera, before.at(ids), frame.at(ids)
    turn = dominant_rotation(x1, x2, 3 * sigma)
    shift = float(np.degrees(median_displacement(turn, x1, x2)))
    if shift >= SPOT_DEG:
        return None
    return Decision("motion beside a turn", shift, SPOT_DEG, True, "deg", "<"), Pose(
        last.rotation @ turn.T, last.translation
    )


def speed_of(world: Map) -> float:
    """Median speed over the map's last frames [units per second], above zero."""
    poses = sorted(world.trajectory(), key=lambda item: item[0])[-10:]
    speeds = [
        float(np.linalg.norm(q.translation - p.translation)) / ((v - u) * 1e-9) for (u, p), (v, q) in pairwise(poses)
    ]
    return max(float(np.median(speeds)), 1e-6)


def carried(covariance: Array, key_from_camera: Pose) -> Array:
    """A key frame's covariance (6, 6) as that of a camera rigidly fixed to it (twists on the right)."""
    back = key_from_camera.inverse()
    rotation = back.rotation
    adjoint = np.block([[rotation, skew(back.translation) @ rotation], [np.zeros((3, 3)), rotation]])
    return adjoint @ covariance @ adjoint.T
