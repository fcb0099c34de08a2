"""Closes loops: describes the keyframes' images for recognition, and corrects the Steps by the loops."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.loops.loops import KeyFrameSeen, seen_again
from ispom.estimators.modern.loops.output_correction import Correction, corrected_step, next_range
from ispom.estimators.modern.loops.relative_pose import FEATURES, DescribedPoints, LoopCamera
from ispom.estimators.modern.rolling import steady
from ispom.estimators.modern.stereo.map import triangulated
from ispom.estimators.modern.stereo.pair import PairPoints, Setup, StereoImages, seen_by
from ispom.estimators.modern.stereo.recover import MIN_DISPARITY_PX
from ispom.estimators.modern.stereo.shutter import pair_at_middle, row_times
from ispom.estimators.modern.stereo.state import ModernStereoState, Outcome, StereoLoops, StereoMap
from ispom.features.descriptors import SEARCH_SIDE_PX
from ispom.features.row_search import PointSearch
from ispom.geometry import Array
from ispom.types import Step, Trajectory

FEATURE_ERROR_PX = 1.0
"""Standard deviation of a feature's position, at the size at which features are detected."""


def with_loops(
    setup: Setup, earlier: ModernStereoState, outcome: Outcome, images: StereoImages, step: Step
) -> tuple[ModernStereoState, Step]:
    """Returns the state with the loops that the frame closes, and its Step corrected by all loops.

    `earlier` is the state before the frame.
    """
    state, loops = outcome.state, earlier.loops
    settled = state.settled.part(len(earlier.settled), len(state.settled))
    key = _keyframe_seen(setup, outcome, images) if outcome.keyframe else None
    seen, decisions = seen_again(loops.loops, loop_camera(setup), key, len(state.poses), setup.asked)
    loops = replace(loops.with_settled(settled), loops=seen)
    step = replace(step, decisions=(*step.decisions, *decisions), joins=seen.joins)
    if seen.closed:
        loops, step = _corrected(setup, loops, state, step)
    return replace(state, loops=loops), step


def corrected(loops: StereoLoops, poses: Trajectory) -> Trajectory:
    """Returns all poses corrected by the loops."""
    return Correction.of(loops.loops).of_trajectory(poses) if loops.loops.closed else poses


def _corrected(setup: Setup, loops: StereoLoops, state: ModernStereoState, step: Step) -> tuple[StereoLoops, Step]:
    """Returns the loops after, and the Step with the frame's pose and some earlier ones corrected by them."""
    seen, revised = next_range(loops.loops, len(state.poses))
    earlier = [
        (t, (pose @ loops.key_pose(state.map, key)).inverse() @ setup.left_from_rig)
        for t, key, pose in state.poses.part(revised.start, revised.stop)
    ]
    last, odometry = state.last, None
    if last.covariance is not None:
        odometry = last.left_from_world.inverse(), last.covariance, 0.0
    return replace(loops, loops=seen), corrected_step(seen, step, earlier, odometry, setup.left_from_rig)


def _keyframe_seen(setup: Setup, outcome: Outcome, images: StereoImages) -> KeyFrameSeen:
    """Returns the newest keyframe of the map for recognition."""
    state, world = outcome.state, outcome.state.map
    return KeyFrameSeen(
        images.time_ns,
        world.keys[-1].left_from_world.inverse(),
        # A left twist of left_from_world is the negative right twist of world_from_left, with the same covariance.
        world.newest_covariance,
        0.0,
        {k.time_ns: k.left_from_world.inverse() for k in world.keys},
        partial(described_points, setup, world, images, steady(state.last.rate)),
        joined=not outcome.restarted,
    )


def described_points(setup: Setup, world: StereoMap, images: StereoImages, motion: Array) -> DescribedPoints:
    """Describes features of the left image; those with a disparity have positions in the left camera.

    `motion` (12,) is as in rolling.steady.
    """
    found = setup.front_end.descriptor.detect_and_describe(images.left, FEATURES)
    disparity = PointSearch().search(images.left, images.right, found.uv).disparity_px
    good = np.isfinite(disparity) & (disparity >= MIN_DISPARITY_PX)
    points = PairPoints(np.arange(int(good.sum())), found.uv[good], disparity[good])
    xyz = np.full((len(found), 3), np.nan)
    xyz[good] = triangulated(setup, world, points, motion)
    return DescribedPoints.of(images.left, _at_middle(setup, found.uv, disparity, motion), found, xyz)


def _at_middle(setup: Setup, uv: NDArray[np.float32], disparity_px: NDArray[np.float32], motion: Array) -> Array:
    """Returns features (N, 2) [px], normalised, at the time of the middle row of a rolling shutter; those without a
    disparity (N,) count as infinitely far."""
    seen = seen_by(setup.camera, uv, disparity_px)
    return pair_at_middle(seen, row_times(setup.camera, seen[:, 1]), motion, setup.baseline_m)[:, :2]


def loop_camera(setup: Setup) -> LoopCamera:
    """Returns the camera with the noise of its features and the matcher."""
    error_px = FEATURE_ERROR_PX * max(1.0, setup.camera.longer_side_px / SEARCH_SIDE_PX)
    return LoopCamera.of(setup.camera, error_px / setup.camera.fx, setup.front_end.matcher, setup.baseline_m)
