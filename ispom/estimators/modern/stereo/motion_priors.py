"""Priors of the keyframes' motions during the exposure of a rolling shutter, from the poses of their neighbours."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ispom.estimators.modern.rolling import steady
from ispom.estimators.modern.stereo.last_pair import SHAKE_RAD_S, motion_sigma
from ispom.estimators.modern.stereo.shutter import MotionPrior
from ispom.estimators.modern.stereo.window import KeyFrame
from ispom.geometry import Array
from ispom.numerics.twist import twist_of


def motion_priors(keys: tuple[KeyFrame, ...], baseline_m: float) -> list[MotionPrior]:
    """Returns the motion prior of each keyframe, from the poses of its neighbours."""
    ways = [b.left_from_world @ a.left_from_world.inverse() for a, b in pairwise(keys)]
    seconds = np.array([b.time_ns - a.time_ns for a, b in pairwise(keys)]) * 1e-9
    rates = np.array([twist_of(way) for way in ways]) / seconds[:, None]
    foreseen = np.array([motion_sigma(way, baseline_m) for way in ways]) / seconds[:, None]
    shaken = SHAKE_RAD_S * _shaken(rates, seconds, foreseen.mean(axis=0) / SHAKE_RAD_S)
    sigma = np.concatenate([shaken, SHAKE_RAD_S * shaken])
    # The rate to the neighbour that is nearer in time has the larger weight.
    share = (seconds[:-1] / (seconds[:-1] + seconds[1:]))[:, None]
    between = (1 - share) * rates[:-1] + share * rates[1:]
    change = (rates[1:] - rates[:-1]) / (0.5 * (seconds[:-1] + seconds[1:]))[:, None]
    inner = np.concatenate([between, change], axis=1)
    every = [steady(rates[0]), *inner, steady(rates[-1])]
    return [MotionPrior(motion, sigma) for motion in every]


def _shaken(rates: Array, seconds: Array, usual: Array) -> Array:
    """Returns standard deviations (6,) of poses from a steady motion, from differences of the mean rates (C, 6) over
    times (C,) [s]. The `usual` (6,) counts as one more difference along one axis."""
    before, after = 1 / seconds[:-1], 1 / seconds[1:]
    # Propagates independent, equal deviations of the middle pose and of those at the ends.
    gain = (before + after) ** 2 + before**2 + after**2
    found = np.diff(rates, axis=0) ** 2 / gain[:, None]
    square = [np.append(found[:, part], usual[part][0] ** 2).mean() for part in (slice(0, 3), slice(3, 6))]
    return np.sqrt(np.repeat(square, 3))
