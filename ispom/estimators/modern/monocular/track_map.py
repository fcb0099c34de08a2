"""Processes one frame with a map: localises it, ends outlier tracks, and at a keyframe extends and optimises the
map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.key_frame import extended, key_frame_tests
from ispom.estimators.modern.monocular.localise import (
    MIN_LOCATED,
    MOST,
    SURE,
    Localisation,
    contradicted,
    localise,
    moving_tracks,
)
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.marginalise import limited, shortened, what_left
from ispom.estimators.modern.monocular.recognise import FEWEST
from ispom.estimators.modern.monocular.recover import recover
from ispom.estimators.modern.monocular.relocate import relocated, relocated_after_loss
from ispom.estimators.modern.monocular.setup import MISTRACKED, MOVING, WIDTH, Setup
from ispom.estimators.modern.monocular.shutter import by_motions
from ispom.estimators.modern.monocular.state import ModernMonocularState, NewImage, Outcome
from ispom.estimators.modern.monocular.tracks import tracked_frame
from ispom.estimators.tracked_frame import MOST_SHOWN_PX, TrackedFrame
from ispom.stopwatch import Stopwatch
from ispom.types import Decision, Status, TrackStatus

MAX_SCALE_GROWTH = 0.3
"""Growth of the standard deviation of ln scale within the window, beyond which the scale is lost: with a factor of 1.35
either way, two parts of a path no longer have the same scale."""
LASTING = 3
"""Number of successive keyframes at which it must be lost."""


def track_map(
    setup: Setup, state: ModernMonocularState, world: Map, new: NewImage, watch: Stopwatch
) -> tuple[ModernMonocularState, Outcome]:
    """Localises the frame, or recovers if that fails; makes it a keyframe if a check requires it.

    Also returns the state used, which has more tracks if the frame was relocalised by descriptors.
    """
    found = localise(setup, state.live, world, new)
    decisions, again = tuple[Decision, ...](), None
    known = np.count_nonzero(world.points.places(state.live.ids) >= 0)
    if not found.agreeing or found.count < MOST * known:
        tracked = len(state.live.ids)
        state, again = relocated(setup, state, world, new)
        if again is not None and (
            again.found.count <= found.count or contradicted(setup, state.live, world, found, again.found)
        ):
            again = None
        if again is not None:
            state, world, found = again.state, again.map, again.found
        decisions = (checks.DESCRIBED_POINTS.of(len(state.live.ids) - tracked, FEWEST),)
    if again is None and found.agreeing:
        sights = (*state.sights, state.live.sight)
        found, world = by_motions(setup, state.live, world, sights, new.time_ns, found)
    watch.lap("locate")
    located = checks.POSE_POINTS.of(found.count, MIN_LOCATED if again is None else SURE, passed=found.agreeing)
    decisions = (*decisions, located)
    if found.motion is None or not found.agreeing:
        return state, recover(setup, state, new, found.followed, decisions)
    frame, outcome = _in_map(setup, state, world, new, found, decisions)
    tests = key_frame_tests(setup, world, frame)
    outcome = replace(outcome, decisions=(*decisions, *tests))
    if again is not None and again.segment != state.segment:
        outcome = replace(outcome, restarted=True, segment=again.segment)
    watch.lap("locate")
    # The points of a relocalised frame are new to the map: only its optimisation gives the covariance of the pose.
    if again is None and not any(test.passed for test in tests):
        seen = found.ids, found.xyz, found.seen, found.motion
        uncertainty = required(state.uncertainty, "the map has no covariance")
        covariance = uncertainty.of_pose(*seen, WIDTH * setup.noise.width, found.untriangulated)
        world, settled = limited(world.with_relative_frame(new.time_ns, frame.pose))
        watch.lap("locate")
        return state, replace(outcome, map=world, settled=tuple(settled), covariance=covariance)
    outcome = _key_frame(setup, outcome, world, frame, state.live.ids)
    watch.lap("key frame")
    known = _scale_known(state, outcome)
    if known is not None:
        outcome = replace(outcome, decisions=(*outcome.decisions, known), restarted=not known.passed)
    return state, outcome


def _scale_known(state: ModernMonocularState, outcome: Outcome) -> Decision | None:
    """Checks that the keyframe has the map's scale as well as keyframes of the window did. None without such keyframes,
    or if the frame was relocalised, which starts another window."""
    if len(state.depth_sigmas) < LASTING or outcome.uncertainty is None or outcome.restarted:
        return None
    # With few points left, later keyframes may still observe the scale.
    now = min(outcome.uncertainty.depth_sigma, *state.depth_sigmas[1 - LASTING :])
    grown = now**2 - min(state.depth_sigmas) ** 2
    return checks.SCALE_KNOWN.of(100 * float(np.sqrt(max(grown, 0.0))), 100 * MAX_SCALE_GROWTH)


def found_after_loss(
    setup: Setup, state: ModernMonocularState, new: NewImage
) -> tuple[ModernMonocularState, Outcome | None]:
    """Continues in the world of a segment before the loss, if the frame matches one of its keyframes.

    Also returns the state used, as `track_map` does.
    """
    state, again = relocated_after_loss(setup, state, new)
    if again is None:
        return state, None
    decisions = (
        checks.DESCRIBED_POINTS.of(len(again.state.live.ids), FEWEST),
        checks.POSE_POINTS.of(again.found.count, SURE),
    )
    frame, outcome = _in_map(setup, again.state, again.map, new, again.found, decisions)
    outcome = replace(outcome, restarted=True, segment=again.segment)
    return again.state, _key_frame(setup, outcome, again.map, frame, again.state.live.ids)


def _in_map(
    setup: Setup,
    state: ModernMonocularState,
    world: Map,
    new: NewImage,
    found: Localisation,
    decisions: tuple[Decision, ...],
) -> tuple[TrackedFrame, Outcome]:
    """Returns the frame with its pose, and its outcome unless it becomes a keyframe."""
    frame, residual_px, inliers = _without_outliers(setup, state, world, new, found)
    outcome = Outcome(
        found.followed,
        Status.TRACKING,
        frame.world_from_camera,
        world,
        decisions=decisions,
        residual_px=residual_px,
        inliers=inliers,
        compared=found.compared,
    )
    return frame, outcome


def _without_outliers(
    setup: Setup, state: ModernMonocularState, world: Map, new: NewImage, found: Localisation
) -> tuple[TrackedFrame, NDArray[np.float32], NDArray[np.bool_]]:
    """Returns the frame with its pose and the tracks that go on, residuals (N,) [px], and which tracks (N,) the pose
    used; the status of outliers is updated."""
    status, live, motion = found.followed.status, state.live, required(found.motion, "the frame was not localised")
    place = np.searchsorted(live.ids, found.ids)
    residual = np.full(len(status), np.nan, np.float32)
    residual[place] = np.minimum(motion.distances * setup.camera.fx, MOST_SHOWN_PX)
    inliers = np.zeros(len(status), bool)
    inliers[place[motion.inliers]] = True
    status[place[motion.distances > MISTRACKED * setup.noise.width]] = TrackStatus.REPROJECTION
    frame = tracked_frame(setup.camera, live, found.followed, new.time_ns)
    frame = replace(frame, world_from_camera=motion.camera_from_world.inverse())
    untriangulated = frame.ids[world.points.places(frame.ids) < 0]
    moving = moving_tracks(world.keys[-1], frame, untriangulated, MOVING * setup.noise.width)
    status[np.searchsorted(live.ids, moving)] = TrackStatus.EPIPOLAR
    return frame.without(moving), residual, inliers


def _key_frame(setup: Setup, outcome: Outcome, world: Map, frame: TrackedFrame, all_ids: NDArray[np.int64]) -> Outcome:
    """Adds points, runs bundle adjustment, and shortens the window."""
    status = outcome.followed.status
    done = extended(setup, world, frame)
    status[np.isin(all_ids, done.dropped) & (status == TrackStatus.ALIVE)] = TrackStatus.REPROJECTION
    alive = all_ids[status == TrackStatus.ALIVE]
    world, settled = shortened(done.map, alive, setup.key_frames)
    return replace(
        outcome,
        pose=world.poses[-1],
        map=world,
        key_frame=True,
        decisions=(*outcome.decisions, *done.decisions, what_left(done.map, world, setup.key_frames)),
        covariance=done.uncertainty.pose,
        uncertainty=done.uncertainty,
        scale=done.scale,
        settled=tuple(settled),
    )
