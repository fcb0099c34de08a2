"""Loop closures of the monocular estimator: describes its keyframes, and corrects its Steps."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.loops.checks import LOOP_SHIFT
from ispom.estimators.modern.loops.loops import KeyFrameSeen, Loops, seen_again
from ispom.estimators.modern.loops.output_correction import Correction, corrected_step, next_range
from ispom.estimators.modern.loops.relative_pose import FEATURES, DescribedPoints, LoopCamera
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.recognise import FEATURE_ERROR
from ispom.estimators.modern.monocular.setup import Setup
from ispom.estimators.modern.monocular.state import ModernMonocularState, NewImage, Outcome
from ispom.estimators.modern.monocular.tracks import Followed, speed_where
from ispom.estimators.modern.rolling import late_px
from ispom.geometry import Pose
from ispom.types import Image, Step, Trajectory


def with_loops(
    setup: Setup,
    before: ModernMonocularState,
    after: ModernMonocularState,
    outcome: Outcome,
    new: NewImage,
    step: Step,
) -> tuple[ModernMonocularState, Step]:
    """Updates the loops after a frame; returns the state, and the Step in the corrected world."""
    camera, key = LoopCamera.of(setup.camera, FEATURE_ERROR * setup.noise.sigma, setup.front_end.matcher), None
    if outcome.key_frame and after.map is not None:
        joined = outcome.segment is not None or (
            not outcome.restarted and (before.start is None or before.start.joined)
        )
        key = _key_frame_seen(setup, after, after.map, outcome, new.grey, joined)
    loops, decisions = seen_again(before.loops, camera, key, len(after.settled))
    joins = step.joins if loops.joins is None else loops.joins
    step = replace(step, decisions=(*step.decisions, *decisions), joins=joins)
    if loops.closed:
        loops, step = _corrected(loops, after, step)
    return replace(after, loops=loops), step


def corrected(loops: Loops, poses: Trajectory) -> Trajectory:
    """Returns all poses, corrected by the loops."""
    return Correction.of(loops).of_trajectory(poses) if loops.closed else poses


def _corrected(loops: Loops, after: ModernMonocularState, step: Step) -> tuple[Loops, Step]:
    loops, again = next_range(loops, len(after.settled))
    earlier = after.settled.part(again.start, again.stop)
    if after.map is not None and any(d.key == LOOP_SHIFT.key for d in step.decisions):
        earlier += after.map.trajectory()
    odometry, variance = None, 0.0 if after.uncertainty is None else after.uncertainty.scale_sigma**2
    if step.world_from_frame is not None and step.covariance is not None:
        odometry = step.world_from_frame, step.covariance, variance
    return loops, corrected_step(loops, step, earlier, odometry, Pose())


def _key_frame_seen(
    setup: Setup, after: ModernMonocularState, world: Map, outcome: Outcome, grey: Image, joined: bool
) -> KeyFrameSeen:
    """Returns the newest keyframe of the map."""
    window = dict(sorted((*outcome.settled, *world.trajectory()), key=lambda told: told[0]))
    newest, pose = world.keys[-1], world.poses[-1]
    variance = 0.0 if after.uncertainty is None else after.uncertainty.scale_sigma**2
    sight = partial(_sight, setup, Lens(setup.camera, world.extra), outcome.followed, grey, _depth(world, pose))
    return KeyFrameSeen(newest.time_ns, pose, outcome.covariance, variance, window, sight, joined, after.segment)


def _depth(world: Map, pose: Pose) -> float:
    """Returns the median depth of the points that the newest keyframe observes."""
    known = world.known(world.keys[-1].ids)
    near = pose.inverse().apply(known[np.isfinite(known[:, 0])])[:, 2]
    return float(np.median(near)) if len(near) else float("nan")


def _sight(setup: Setup, lens: Lens, followed: Followed, grey: Image, depth: float) -> DescribedPoints:
    """Describes a keyframe. With a rolling shutter, features are moved to the time of the middle row, with the
    velocities of the nearest tracks."""
    found = setup.front_end.descriptor.detect_and_describe(grey, FEATURES)
    uv = found.uv - late_px(lens.camera, found.uv, speed_where(followed, found.uv))
    return DescribedPoints.of(grey, lens.normalise(uv), found, depth=depth)
