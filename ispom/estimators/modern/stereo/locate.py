"""Locating a pair: reprojection of the known points in both images, from a prediction, or samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.stereo.last_pair import LastPair, unforeseen
from ispom.estimators.modern.stereo.pair_calibration import with_ideal_right
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.window import StereoMap
from ispom.geometry import Array, Pose
from ispom.solvers.motion_only import PoseFit, fit_pose
from ispom.solvers.multiview.resection import resect

MIN_INLIER_SHARE = 0.6
"""A pose refined from a prediction that fewer of its points agree with is sought again from three-point samples."""
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
) -> PoseFit | None:
    """left_from_world by reprojection in both images; from three-point samples where the prediction is poor.

    `place` (N,) of the points in the map, `seen` (N, 3) as KeyFrame.seen.
    """
    xyz, prior = world.xyz[place], None
    moved = predicted @ last.left_from_world.inverse()
    rate = moved.log() / ((time_ns - last.time_ns) * 1e-9)
    if len(xyz) < FEW * setup.min_inliers:
        prior = np.diag(unforeseen(moved, setup.baseline_m) ** -2)
    seen = with_ideal_right(setup, world, predicted.apply(xyz), seen, rate)
    limits = setup.loss, setup.limit, setup.baseline_m
    found = fit_pose(xyz, seen, predicted, *limits, prior)
    if found is None or found.inliers.mean() < MIN_INLIER_SHARE:
        sampled = resect(xyz, seen[:, :2], setup.limit)
        if sampled is not None:
            again = fit_pose(xyz, seen, sampled.camera_from_world, *limits, prior, widest=setup.limit)
            if again is not None and (found is None or again.inliers.sum() > found.inliers.sum()):
                found = again
    return found
