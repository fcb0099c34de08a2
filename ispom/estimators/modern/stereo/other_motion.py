"""Checks whether a second rigid motion explains a frame's outliers, and localises by it if it is to be followed, see
`second_motion`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.second_motion import (
    INLIER,
    Moving,
    enough_outliers,
    off_epipolar_lines,
    preferred,
    second_motion_decision,
)
from ispom.estimators.modern.stereo.localise import localise, match_right
from ispom.estimators.modern.stereo.pair import Setup, StereoImages, TrackingResult
from ispom.estimators.modern.stereo.state import ModernStereoState
from ispom.geometry import Pose
from ispom.solvers.localisation import PoseFit, resect
from ispom.types import Decision, Tracks, TrackStatus

SAMPLES = 110
"""Number of samples of four points: if half of the points are inliers (fewer do not count), one sample has only inliers
with a probability of 99.9 %."""


def with_other_motion(
    setup: Setup, state: ModernStereoState, images: StereoImages, tracked: TrackingResult
) -> tuple[TrackingResult, tuple[Decision, ...], Tracks | None]:
    """Localises the frame by the motion to follow; returns the decisions and the tracks of the other motion as well.

    There are no decisions with too few outliers, and no tracks without a second motion.
    """
    fit = tracked.located
    if fit is None:
        return tracked, (), None
    explained, left_from_world, tests = other_motion(setup, state, tracked, fit)
    if left_from_world is None:
        return tracked, tests, None
    part, left = tracked.took_part, state.map.left(setup.camera)
    xyz, uv = state.map.xyz[tracked.place[part]], tracked.uv[part]
    errors = [np.linalg.norm(left.project(p.apply(xyz)) - uv, axis=1) for p in (fit.camera_from_world, left_from_world)]
    # After little motion, far points are inliers of both.
    nearer = (errors[1] < errors[0]) & (errors[1] < INLIER * setup.noise_px.width)
    others, own = part[nearer], part[fit.inliers & ~nearer]
    other_side, own_side = (
        Moving(state.last.points.ids[of], tracked.uv[of], state.map.xyz[tracked.place[of]]) for of in (others, own)
    )
    test = preferred(setup.follow, other_side, own_side, (setup.camera.width, setup.camera.height))
    if not test.passed:
        return tracked, (*tests, test), _tracks(state, tracked, explained)
    status = tracked.status.copy()
    status[part], status[others] = TrackStatus.REPROJECTION, TrackStatus.ALIVE
    followed = match_right(setup, state, images, replace(tracked, status=status), left_from_world)
    followed = localise(setup, state, images, followed, left_from_world)
    return followed, (*tests, test), _tracks(state, tracked, own)


def other_motion(
    setup: Setup, state: ModernStereoState, tracked: TrackingResult, fit: PoseFit
) -> tuple[NDArray[np.int64], Pose | None, tuple[Decision, ...]]:
    """Finds a second rigid motion that maps the outliers of the frame's pose `fit`, from their positions in the map, to
    their observations.

    Returns the indices (M,) of its inliers among the last frame's points, left_from_world relative to these points, and
    the check. Without a second motion there are no inliers; with too few outliers there is no check.
    """
    none, outliers = np.zeros(0, np.int64), tracked.took_part[~fit.inliers]
    left, last, width = state.map.left(setup.camera), state.last, setup.noise.width
    x = left.normalise(tracked.uv[outliers])
    if len(state.map.keys) == 1 and state.map.covariance is None:
        # After one keyframe the calibration is uncorrected, and wrong depths look like motion along epipolar lines.
        left_from_last = fit.camera_from_world @ last.left_from_world.inverse()
        off = off_epipolar_lines(left_from_last, left.normalise(last.points.uv[outliers]), x, INLIER * width)
        outliers, x = outliers[off], x[off]
    count = len(tracked.took_part)
    if not enough_outliers(len(outliers), count):
        return none, None, ()
    found = resect(state.map.xyz[tracked.place[outliers]], x, INLIER * width, samples=SAMPLES)
    explained = np.zeros(len(outliers), bool) if found is None else found.inliers
    test = second_motion_decision(explained, count)
    if found is None or test.passed:
        return none, None, (test,)
    return outliers[explained], found.camera_from_world, (test,)


def _tracks(state: ModernStereoState, tracked: TrackingResult, of: NDArray[np.int64]) -> Tracks:
    """Returns these points as tracks of a Step."""
    points = state.last.points
    return Tracks.of(points.ids[of], tracked.uv[of], uv_prev=points.uv[of], disparity_px=tracked.disparity_px[of])
