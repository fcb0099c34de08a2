"""Loops of the stereo estimator: what its key frames show, and its Steps as they are with the loops."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.loops.loops import KeyFrameSeen, seen_again
from ispom.estimators.modern.loops.output_correction import Correction, corrected_step, next_range
from ispom.estimators.modern.loops.relative_pose import FEATURES, DescribedPoints, LoopCamera
from ispom.estimators.modern.rolling import steady
from ispom.estimators.modern.stereo.pair import NewPair, PairPoints
from ispom.estimators.modern.stereo.pair_calibration import intersected
from ispom.estimators.modern.stereo.relocate import MIN_DISPARITY_PX
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.shutter import pair_at_middle, row_times
from ispom.estimators.modern.stereo.state import ModernStereoState, Outcome, StereoLoops
from ispom.estimators.modern.stereo.window import StereoMap, newest_covariance
from ispom.features.descriptors import SEARCH_SIDE_PX
from ispom.features.row_search import PointSearch
from ispom.geometry import Array
from ispom.types import Step, Trajectory

FEATURE_ERROR_PX = 1.0
"""Deviation of a feature's place, at the size at which features are looked for."""


def with_loops(
    setup: Setup, before: ModernStereoState, outcome: Outcome, new: NewPair, step: Step
) -> tuple[ModernStereoState, Step]:
    """The state after a pair, with what is known of loops, and its Step in the world as they make it."""
    after, loops = outcome.after, before.loops
    settled = after.settled.part(len(before.settled), len(after.settled))
    key = _key_frame_seen(setup, outcome, new) if outcome.key_frame else None
    seen, decisions = seen_again(loops.loops, loop_camera(setup), key, len(after.poses))
    loops = replace(loops.with_settled(settled), loops=seen)
    step = replace(step, decisions=(*step.decisions, *decisions), joins=seen.joins)
    if seen.closed:
        loops, step = _corrected(setup, loops, after, step)
    return replace(after, loops=loops), step


def corrected(loops: StereoLoops, poses: Trajectory) -> Trajectory:
    """All poses with the loops."""
    return Correction.of(loops.loops).of_trajectory(poses) if loops.loops.closed else poses


def _corrected(setup: Setup, loops: StereoLoops, after: ModernStereoState, step: Step) -> tuple[StereoLoops, Step]:
    seen, again = next_range(loops.loops, len(after.poses))
    earlier = [
        (t, (pose @ loops.key_pose(after.map, key)).inverse() @ setup.left_from_rig)
        for t, key, pose in after.poses.part(again.start, again.stop)
    ]
    last, odometry = after.last, None
    if last.covariance is not None:
        odometry = last.left_from_world.inverse(), last.covariance, 0.0
    return replace(loops, loops=seen), corrected_step(seen, step, earlier, odometry, setup.left_from_rig)


def _key_frame_seen(setup: Setup, outcome: Outcome, new: NewPair) -> KeyFrameSeen:
    """The newest key frame of the map."""
    after, world = outcome.after, outcome.after.map
    return KeyFrameSeen(
        new.time_ns,
        world.keys[-1].left_from_world.inverse(),
        # left_from_world's left twist is one on the right of world_from_left, the other way.
        newest_covariance(world),
        0.0,
        {k.time_ns: k.left_from_world.inverse() for k in world.keys},
        partial(_sight, setup, world, new, steady(after.last.rate)),
        joined=not outcome.restarted,
    )


def _sight(setup: Setup, world: StereoMap, new: NewPair, motion: Array) -> DescribedPoints:
    found = setup.front_end.descriptor.detect_and_describe(new.left, FEATURES)
    disparity = PointSearch().search(new.left, new.right, found.uv).disparity_px
    good = np.isfinite(disparity) & (disparity >= MIN_DISPARITY_PX)
    points = PairPoints(np.arange(int(good.sum())), found.uv[good], disparity[good])
    xyz = np.full((len(found), 3), np.nan)
    xyz[good] = intersected(setup, world, points, motion)
    return DescribedPoints.of(new.left, _at_middle(setup, found.uv, disparity, motion), found, xyz)


def _at_middle(setup: Setup, uv: NDArray[np.float32], disparity_px: NDArray[np.float32], motion: Array) -> Array:
    """Normalised (N, 2) where the middle row of a rolling shutter would have seen features (N, 2) [px]; what has no
    disparity (N,) is far."""
    seen = PairPoints(np.arange(len(uv)), uv, disparity_px).seen_by(setup.camera)
    return pair_at_middle(seen, row_times(setup.camera, seen[:, 1]), motion, setup.baseline_m)[:, :2]


def loop_camera(setup: Setup) -> LoopCamera:
    error_px = FEATURE_ERROR_PX * max(1.0, setup.camera.longer_side_px / SEARCH_SIDE_PX)
    return LoopCamera.of(setup.camera, error_px / setup.camera.fx, setup.front_end.matcher, setup.baseline_m)
