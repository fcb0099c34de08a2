"""Locating a pair: reprojection of the known points in both images, from a prediction, or samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.stereo.last_pair import LastPair, motion_sigma
from ispom.estimators.modern.stereo.pair_calibration import ideal
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.shutter import Rows
from ispom.estimators.modern.stereo.window import StereoMap, variance_factor
from ispom.geometry import Array, Pose
from ispom.numerics.twist import twist_of
from ispom.solvers.localisation import Policy, PoseFit, locate

POOR = 2.0
"""A pose whose inliers have a larger median error, in noise of a track, is sought again: where a turn was not
foretold, a sixth of the points, found on a road that looks the same everywhere, pulled a pose 0.2 m away within what
the others, far off, agree with."""
CLOSE = 4.0
"""Points of a sample agree with its pose within so many times that."""
ROUNDS = 3
"""The pose is located, and how it moves while the rows are exposed, so many times in turn."""
FEW = 3
"""With fewer points than so many times the least number, the expected motion counts as well."""


def located(
    setup: Setup,
    last: LastPair,
    world: StereoMap,
    place: NDArray[np.int64],
    seen: Array,
    predicted: Pose,
    time_ns: int,
    motion: Array | None = None,
) -> tuple[PoseFit | None, Array | None]:
    """left_from_world by reprojection in both images; from three-point samples where the prediction is poor. Of a
    rolling shutter also how it moved meanwhile (12,), as of rolling.mean_rates.

    `place` (N,) of the points in the map, `seen` (N, 3) as KeyFrame.seen.
    """
    if not setup.shutter.rolls:
        seen = _ideal(setup, last, world, place, seen, predicted, time_ns)
        return _located(setup, last, world, place, seen, predicted), None
    believed = last.believed_motion(time_ns, setup.baseline_m)
    believed = replace(believed, sigma=believed.sigma / np.sqrt(variance_factor(world, setup.noise)))
    rows = Rows(setup.shutter, world.xyz[place], seen[:, 1], setup.baseline_m, setup.noise.width)
    motion, found = believed.motion if motion is None else motion, None
    for _ in range(ROUNDS):
        guess = predicted if found is None else found.camera_from_world
        middle = setup.shutter.at_middle(seen, motion, setup.baseline_m)
        middle = _ideal(setup, last, world, place, middle, guess, time_ns)
        found = _located(setup, last, world, place, middle, guess)
        if found is None:
            return None, None
        motion, found = rows.refined(believed, motion, middle, found)
    return found, motion


def _ideal(
    setup: Setup,
    last: LastPair,
    world: StereoMap,
    place: NDArray[np.int64],
    seen: Array,
    predicted: Pose,
    time_ns: int,
) -> Array:
    """(N, 3) what a perfect pair would have seen."""
    rate = twist_of(predicted @ last.left_from_world.inverse()) / ((time_ns - last.time_ns) * 1e-9)
    return ideal(world, setup.baseline_m, predicted.apply(world.xyz[place]), seen, rate)


def _located(
    setup: Setup, last: LastPair, world: StereoMap, place: NDArray[np.int64], seen: Array, predicted: Pose
) -> PoseFit | None:
    """By what all rows of a perfect pair saw at one time."""
    xyz, prior = world.xyz[place], None
    if len(xyz) < FEW * setup.min_inliers:
        prior = np.diag(motion_sigma(predicted @ last.left_from_world.inverse(), setup.baseline_m) ** -2)
    usual = max(setup.noise.width, world.noise.sigma(setup.noise.sigma))
    policy = Policy(setup.noise.width, setup.limit, CLOSE * usual, POOR * usual)
    return locate(xyz, seen, predicted, policy, setup.baseline_m, prior)
