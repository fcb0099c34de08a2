"""Where a frame is: against the map, beside a pure turn, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.start import MIN_POINTS
from ispom.estimators.modern.monocular.tracks import Followed
from ispom.estimators.paper.keyframes import Frame
from ispom.geometry import Array, Pose, skew
from ispom.solvers import motion_only
from ispom.solvers.motion_only import PoseFit
from ispom.solvers.resection import resect
from ispom.solvers.rotation import dominant_rotation, median_displacement, rotate
from ispom.types import Decision

SPOT_DEG = 0.5
"""Tracks that a turn alone explains to within this (median) show no travel."""
MIN_LOCATED = 15
"""Fewer points that agree with a pose are a loss."""
COASTING_S = 2.0
"""Out of sight motion goes on as before, and fades within this time."""


@dataclass(frozen=True, eq=False)
class Sight:
    """What a frame sees of the map."""

    followed: Followed
    compared: NDArray[np.bool_]
    """Which tracks were found by the patch of their origin."""
    motion: PoseFit | None
    ids: NDArray[np.int64]
    """(N,) ascending, of the points seen."""
    xyz: Array
    """(N, 3)."""

    @property
    def agreeing(self) -> bool:
        """Whether enough points agree with one pose."""
        return self.motion is not None and int(self.motion.inliers.sum()) >= MIN_LOCATED


def coasted(recent: tuple[tuple[int, Pose], ...], time_ns: int) -> Pose:
    """world_from_camera at the velocity of the last two poses, which fades."""
    (before_ns, before), (last_ns, last) = recent[0], recent[-1]
    if before_ns == last_ns:
        return last
    share = COASTING_S * -np.expm1(-(time_ns - last_ns) * 1e-9 / COASTING_S) / ((last_ns - before_ns) * 1e-9)
    return last @ Pose.exp((before.inverse() @ last).log() * share)


def locate(xyz: Array, x: Array, world_from_guess: Pose, limit: float) -> PoseFit | None:
    """From the predicted pose, or, where that leads nowhere, by P3P in RANSAC. `limit` in normalised units."""
    found = motion_only.fit_pose(xyz, x, world_from_guess.inverse(), limit / 2, limit)
    if found is None or found.inliers.mean() < 0.6:
        again = resect(xyz, x, limit)
        other = (
            None
            if again is None
            else motion_only.fit_pose(xyz, x, again.camera_from_world, limit / 2, limit, widest=limit)
        )
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
    return checks.TURN_ONLY.of(shift, SPOT_DEG), Pose(last.rotation @ turn.T, last.translation)


def strays(key: Frame, frame: Frame, ids: NDArray[np.int64], limit: float) -> NDArray[np.int64]:
    """Those of the tracks `ids` (M,), where both frames have them, that are no images of a still point.

    They are farther than `limit` (normalised) from their epipolar line, which begins where an infinitely far point is.
    """
    assert key.world_from_camera is not None and frame.world_from_camera is not None
    ids = np.intersect1d(key.ids, ids, assume_unique=True)
    motion = frame.world_from_camera.inverse() @ key.world_from_camera
    far = rotate(motion.rotation, key.at(ids))
    line = motion.translation[:2] - far * motion.translation[2]
    line /= np.maximum(np.linalg.norm(line, axis=1, keepdims=True), 1e-12)
    moved = frame.at(ids) - far
    along = np.maximum((moved * line).sum(axis=1, keepdims=True), 0.0)
    return ids[np.linalg.norm(moved - along * line, axis=1) > limit]


def speed_of(world: Map) -> float:
    """Median speed over the map's last frames [units per second], above zero."""
    poses = sorted(world.trajectory(), key=lambda item: item[0])[-10:]
    speeds = [
        float(np.linalg.norm(q.translation - p.translation)) / ((v - u) * 1e-9) for (u, p), (v, q) in pairwise(poses)
    ]
    return max(float(np.median(speeds)), 1e-6)


def carried(covariance: Array, before_from_now: Pose) -> Array:
    """A pose's covariance (6, 6) as that of a camera rigidly fixed to it (twists on the right)."""
    back = before_from_now.inverse()
    rotation = back.rotation
    adjoint = np.block([[rotation, skew(back.translation) @ rotation], [np.zeros((3, 3)), rotation]])
    return adjoint @ covariance @ adjoint.T


def coasted_covariance(covariance: Array, before_from_now: Pose) -> Array:
    """Of a pose reached out of sight, from that of the last one in sight: half of the way may be wrong."""
    way, turn = np.linalg.norm(before_from_now.translation), np.linalg.norm(before_from_now.rotvec)
    return carried(covariance, before_from_now) + np.diag([(way / 2) ** 2] * 3 + [(turn / 2) ** 2] * 3)
