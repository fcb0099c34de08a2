"""Motion model for frames without observations: the velocity of the last two poses, which decays."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ispom.estimators.modern.monocular.map import Map
from ispom.geometry import Array, Pose
from ispom.numerics.twist import twist_of

COASTING_S = 2.0
"""Time constant [s] of the decay: a vehicle's speed changes on that scale."""
MIN_SPEED = 1e-6
"""Least speed [units/s], so that a map at rest has a scale, too."""
COASTING_SHARE = 0.5
"""Standard deviation of an unobserved motion, as a share of it."""


def coasted(recent: tuple[tuple[int, Pose], ...], time_ns: int) -> Pose:
    """Predicts world_from_camera with the decaying velocity of the last two poses."""
    (before_ns, before), (last_ns, last) = recent[0], recent[-1]
    if before_ns == last_ns:
        return last
    share = COASTING_S * -np.expm1(-(time_ns - last_ns) * 1e-9 / COASTING_S) / ((last_ns - before_ns) * 1e-9)
    return last @ Pose.exp(twist_of(before.inverse() @ last) * share)


def coasted_covariance(covariance: Array, before_from_now: Pose) -> Array:
    """Returns the covariance of a predicted pose, from that of the last estimated one, with an error of COASTING_SHARE
    of the motion."""
    adjoint = before_from_now.inverse().adjoint
    way, turn = np.linalg.norm(before_from_now.translation), np.linalg.norm(before_from_now.rotvec)
    return adjoint @ covariance @ adjoint.T + np.diag(
        [(COASTING_SHARE * way) ** 2] * 3 + [(COASTING_SHARE * turn) ** 2] * 3
    )


def speed_of(world: Map) -> float:
    """Returns the median speed over the map's last frames [units/s], at least MIN_SPEED."""
    poses = sorted(world.trajectory(), key=lambda item: item[0])[-10:]
    speeds = [
        float(np.linalg.norm(q.translation - p.translation)) / ((v - u) * 1e-9) for (u, p), (v, q) in pairwise(poses)
    ]
    return max(float(np.median(speeds)), MIN_SPEED)
