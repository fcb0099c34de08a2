"""Checks after localisation whether one other rigid motion explains the outlier tracks, see `second_motion`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.monocular.localise import moving_tracks
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.recover import new_start
from ispom.estimators.modern.monocular.setup import MOVING, Setup
from ispom.estimators.modern.monocular.state import ModernMonocularState, NewImage, Outcome
from ispom.estimators.modern.monocular.tracks import tracked_frame
from ispom.estimators.modern.rolling import late_px
from ispom.estimators.modern.second_motion import (
    LEAST,
    Moving,
    enough_outliers,
    explained_by_motion,
    preferred,
    second_motion_decision,
)
from ispom.estimators.tracked_frame import TrackedFrame
from ispom.geometry import Pose
from ispom.types import Decision, Status, Tracks, TrackStatus

PAUSE = 5
"""Number of images without a search after one that found no motion: tracks that slide along contours would be tested at
each image."""
NONE = np.zeros(0, np.int64)


def with_other_motion(setup: Setup, state: ModernMonocularState, outcome: Outcome, new: NewImage) -> Outcome:
    """Tracks the outliers of the pose further, and adds the check of a second motion to the outcome.

    Starts a new map if the other motion is to be followed.
    """
    live, world, pose = state.live, outcome.map, outcome.pose
    if world is None or pose is None or live.grey is None or outcome.residual_px is None:
        return outcome
    tracks = state.outlier_tracks.followed(live.grey, new.grey, new.followed.others)
    x = setup.camera.normalise(tracks.uv - late_px(setup.camera, tracks.uv, tracks.speed(live, new.time_ns)))
    frame = TrackedFrame(new.time_ns, tracks.ids[tracks.lasting], x[tracks.lasting], pose)
    agreeing = (outcome.followed.status == TrackStatus.ALIVE) & np.isfinite(outcome.residual_px)
    test, moving = None, NONE
    if not tracks.rest:
        test, moving = other_motion(world, frame, int(agreeing.sum()), setup.noise.width)
    if test is not None and test.passed:
        tracks = replace(tracks, rest=PAUSE)
    other = tracks.tracks(moving)
    outcome = replace(
        outcome,
        decisions=outcome.decisions if test is None else (*outcome.decisions, test),
        outlier_tracks=tracks.explained(moving).joined(live, outcome.followed, setup.max_tracks),
        other_motion=other,
    )
    if len(moving) and setup.follow == "largest":
        return _larger(setup, state, outcome, new, world, pose, other, agreeing)
    return outcome


def _larger(
    setup: Setup,
    state: ModernMonocularState,
    outcome: Outcome,
    new: NewImage,
    world: Map,
    pose: Pose,
    other: Tracks,
    agreeing: NDArray[np.bool_],
) -> Outcome:
    """Starts a new map if the other motion covers more of the image than the inliers of the pose do, which are the
    live tracks of the mask `agreeing` (N,)."""
    live, followed = state.live, outcome.followed
    test = preferred(
        setup.follow,
        Moving(other.ids, other.uv, world.known(other.ids)),
        Moving(live.ids[agreeing], followed.uv[agreeing], world.known(live.ids[agreeing])),
        (setup.camera.width, setup.camera.height),
    )
    decisions = (*outcome.decisions, test)
    if not test.passed:
        return replace(outcome, decisions=decisions)
    frame = tracked_frame(setup.camera, live, followed, new.time_ns)
    begun = new_start(setup, state, frame, followed, pose, None, decisions)
    # Keyframes were static in another world than the one followed now.
    start = None if begun.start is None else replace(begun.start, lost=None)
    return replace(begun, start=start, status=Status.INITIALISING, other_motion=other)


def other_motion(
    world: Map, frame: TrackedFrame, agreeing: int, width: float
) -> tuple[Decision | None, NDArray[np.int64]]:
    """Checks whether one other motion explains the outlier tracks of a frame; `agreeing` is the number of inliers.

    Returns the check, None for too few outliers, and the ids (M,) of the explained tracks, none if it passed. The
    tracks are compared with the keyframe that observes most of them; those consistent with a static point are excluded.
    `width` of the robust loss, normalised.
    """
    if len(frame.ids) < LEAST:
        return None, NONE
    key = max(reversed(world.keys), key=frame.common)
    ids = moving_tracks(key, frame, frame.ids, MOVING * width)
    count = agreeing + len(ids)
    if not enough_outliers(len(ids), count):
        return None, NONE
    explained = explained_by_motion(key.at(ids), frame.at(ids), width)
    test = second_motion_decision(explained, count)
    return test, NONE if test.passed else ids[explained]
