"""What the pair's calibration errors found so far (offset, bend, late right shutter) do to what is seen."""

from __future__ import annotations

import numpy as np

from ispom.estimators.modern.stereo.pair import PairPoints
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.window import StereoMap
from ispom.geometry import Array
from ispom.solvers.late_shutter import drift
from ispom.solvers.window.adjustment import offset_at

LEAST_DISPARITY = 1 / 2000
"""Normalised; a smaller one says no more than that the point is far."""


def with_ideal_right(setup: Setup, world: StereoMap, near: Array, seen: Array, rate: Array) -> Array:
    """Observations (N, 3) with the right x of a perfect pair, where points are `near` (N, 3) in the left camera."""
    right, lag = seen[:, 2], world.extra[1]
    late = drift(near, np.broadcast_to(world.rate_for_lag(rate), (len(near), 6)), lag, setup.baseline_m)
    return np.column_stack([seen[:, :2], right - offset_at(right, world.extra) - (1 + right**2) * lag * late])


def intersected(setup: Setup, world: StereoMap, points: PairPoints, rate: Array) -> Array:
    """Points (N, 3) in the left camera from disparities without the errors of the pair found so far; at 2000 baselines
    at most. Of a rolling shutter in that of the middle row."""
    seen, moving = points.seen_by(setup.camera), rate
    lag, rate = world.extra[1], world.rate_for_lag(rate)
    x, y, right = seen[:, 0], seen[:, 1], seen[:, 2] - offset_at(seen[:, 2], world.extra)
    disparity = x - right + lag * (rate[4] - rate[5] * y - right * (rate[3] * y - rate[4] * x))
    depth = (setup.baseline_m - lag * (rate[0] - right * rate[2])) / np.maximum(disparity, LEAST_DISPARITY)
    near = np.column_stack([seen[:, :2], np.ones(len(seen))]) * depth[:, None]
    return setup.shutter.points_at_middle(near, moving)
