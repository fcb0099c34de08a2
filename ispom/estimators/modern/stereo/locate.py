"""Localises a frame by reprojection of the map in both images, from a prediction or by RANSAC."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.stereo.last_pair import LastPair, motion_sigma
from ispom.estimators.modern.stereo.pair_calibration import ideal
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.shutter import pair_at_middle, refined_motion, row_times
from ispom.estimators.modern.stereo.window import StereoMap, variance_factor
from ispom.geometry import Array, Pose
from ispom.numerics.twist import twist_of
from ispom.solvers.influence.problem import report_problem
from ispom.solvers.influence.resection import ResectionProblem
from ispom.solvers.localisation import Policy, PoseFit, locate

POOR = 2.0
"""Largest median error of a pose's inliers, relative to the noise of tracks; above it the pose is found again by
RANSAC. On an unpredicted turn a sixth of the points, wrong matches on a uniform road, had pulled a pose away by 0.2 m,
within the tolerance of the other, distant points."""
CLOSE = 4.0
"""Inlier threshold of RANSAC, relative to the noise of tracks."""
ROUNDS = 3
"""Number of times that the pose, and the motion during the exposure of the rows, are estimated in turn."""
FEW = 3
"""Number of points, relative to the least number, below which the predicted motion is a prior of the pose."""


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
    """Finds left_from_world by reprojection in both images, and by three-point RANSAC if the prediction is poor.

    `place` (N,) are indices of the points in the map, `seen` (N, 3) is as KeyFrame.seen. For a rolling shutter it also
    returns the motion (12,) during the exposure, see rolling.steady.
    """
    late_s = row_times(setup.camera, seen[:, 1])
    if late_s is None:
        seen = _ideal(setup, last, world, place, seen, predicted, time_ns)
        return _located(setup, last, world, place, seen, predicted), None
    believed = last.believed_motion(time_ns, setup.baseline_m)
    believed = replace(believed, sigma=believed.sigma / np.sqrt(variance_factor(world, setup.noise)))
    motion, found = believed.motion if motion is None else motion, None
    for _ in range(ROUNDS):
        guess = predicted if found is None else found.camera_from_world
        middle = pair_at_middle(seen, late_s, motion, setup.baseline_m)
        middle = _ideal(setup, last, world, place, middle, guess, time_ns)
        found = _located(setup, last, world, place, middle, guess)
        if found is None:
            return None, None
        rows = world.xyz[place], middle, late_s, setup.baseline_m, setup.noise.width
        motion, found = refined_motion(*rows, believed, motion, found)
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
    """Returns the observations (N, 3) that a pair without calibration errors would have made."""
    rate = twist_of(predicted @ last.left_from_world.inverse()) / ((time_ns - last.time_ns) * 1e-9)
    return ideal(world, setup.baseline_m, predicted.apply(world.xyz[place]), seen, rate)


def _located(
    setup: Setup, last: LastPair, world: StereoMap, place: NDArray[np.int64], seen: Array, predicted: Pose
) -> PoseFit | None:
    """Localises by observations of a pair without calibration errors whose rows are all exposed at one time."""
    xyz, prior = world.xyz[place], None
    if len(xyz) < FEW * setup.min_inliers:
        prior = np.diag(motion_sigma(predicted @ last.left_from_world.inverse(), setup.baseline_m) ** -2)
    usual = max(setup.noise.width, world.noise.sigma(setup.noise.sigma))
    policy = Policy(setup.noise.width, setup.limit, CLOSE * usual, POOR * usual)
    found = locate(xyz, seen, predicted, policy, setup.baseline_m, prior)
    if found is not None:
        pose, given = found.camera_from_world, (setup.noise.width, "left", setup.baseline_m, predicted, prior)
        report_problem(lambda: ResectionProblem(world.ids[place], xyz, seen, pose, *given))
    return found
