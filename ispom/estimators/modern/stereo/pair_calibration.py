"""Corrects observations for the calibration errors found so far, and learns about these from the rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.stereo.pair import PairPoints
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.shutter import points_at_middle
from ispom.estimators.modern.stereo.window import StereoMap, known_of_pair
from ispom.geometry import Array
from ispom.solvers.right_camera import LAG, LEAST_DISPARITY, by_row, drift, row_evidence, without_errors


def ideal(world: StereoMap, baseline_m: float, near: Array, seen: Array, rate: Array) -> Array:
    """Returns observations (N, 3) without calibration errors; the points are `near` (N, 3) in the left camera."""
    return without_errors(seen, world.extra, drift(near, rate[None], world.extra[LAG], baseline_m))


def intersected(setup: Setup, world: StereoMap, points: PairPoints, motion: Array) -> Array:
    """Triangulates points (N, 3) in the left camera from corrected disparities, at 2000 baselines at most.

    `motion` (12,) is as in rolling.steady. For a rolling shutter the points are in the camera of the middle row.
    """
    seen = without_errors(points.seen_by(setup.camera), world.extra)
    (x, y, right), lag, rate = seen.T, world.extra[LAG], motion[:6]
    disparity = x - right + lag * (rate[4] - rate[5] * y - right * (rate[3] * y - rate[4] * x))
    depth = (setup.baseline_m - lag * (rate[0] - right * rate[2])) / np.maximum(disparity, LEAST_DISPARITY)
    near = np.column_stack([seen[:, :2], np.ones(len(seen))]) * depth[:, None]
    return points_at_middle(setup.camera, near, motion)


def with_rows(
    setup: Setup, world: StereoMap, ids: NDArray[np.int64], near: Array, lower: Array, rate: Array
) -> StereoMap:
    """Adds the vertical disparities `lower` (N,) of points, `near` (N, 3) in the left camera, to the map's prior."""
    if world.prior is None or not setup.self_calibration:
        return world
    seen = (near[:, :2] - (setup.baseline_m, 0.0)) / np.maximum(near[:, 2:], 1e-6)
    late = drift(near, rate[None], world.extra[LAG], setup.baseline_m)
    disparity = setup.baseline_m / np.maximum(near[:, 2], 1e-6)
    factors, known = by_row(seen, disparity, late), known_of_pair(world, setup.extra_sigma)
    factors = np.where(near[:, 2:] > 1e-6, factors, np.nan)
    evidence = row_evidence(ids, factors, lower, world.extra, known, setup.noise.width)
    return replace(world, prior=world.prior.with_evidence(evidence))
