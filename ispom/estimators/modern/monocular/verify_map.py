"""Verifies the map after localisation.

One other rigid motion may explain the outlier tracks (see `second_motion`). Points of a wrong map, or of moving water,
soon contradict it; a young map that most points contradict is taken back.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.localise import moving_tracks
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.recover import new_start
from ispom.estimators.modern.monocular.setup import MOVING, Setup
from ispom.estimators.modern.monocular.state import BeforeMap, ModernMonocularState, Outcome
from ispom.estimators.modern.monocular.tracks import NewImage, tracked_frame
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
from ispom.persistent_list import PersistentList
from ispom.types import Decision, Status, TrackStatus

SEARCH_PAUSE = 5
"""Number of images without a search after one that found no motion: tracks that slide along contours would be tested at
each image."""
NO_TRACKS = np.zeros(0, np.int64)
LASTING_FRAMES, LASTING_KEYFRAMES = 10, 3
"""Number of frames for which points should agree, or of keyframes if these come sooner: with wide steps, each frame
adds as much parallax, and as much error, as several others do."""
MIN_LASTING_SHARE = 2 / 3
"""Least share of the points that agree for that long. In five of six simulations of water it falls to 0.35 to 0.63
within 30 frames; the sixth moves too much like a rigid scene. Before static walls it is 0.99, also with cards that
move independently on half of the image."""
MIN_YOUNG_SHARE = 1 / 3
"""The same for a young map: with less, twice as many points contradict it as agree, and it is taken back. First maps
with random depths (factors of 3.3 and 7.4 at 1 sigma) fall to 0.27 and 0.01; with 2.2 the share fell to 0.58 only, and
the map recovered. Chosen with hard/realsense_office, too, where blurred images of a turning camera leave 0.39: with 1/2
that map was taken back, and none was made for 130 frames."""
YOUNG_FRAMES = 20
"""Number of localised frames for which a map is young: a wrong one shows in the first keyframes after it, and poses of
more frames would be lost with it."""


def check_other_motion(setup: Setup, state: ModernMonocularState, outcome: Outcome, image: NewImage) -> Outcome:
    """Tracks the outliers of the pose further, and adds the check of a second motion to the outcome.

    Starts a new map if the other motion is to be followed.
    """
    live, local_map, pose = state.live, outcome.map, outcome.pose
    if local_map is None or pose is None or live.grey is None or outcome.residual_px is None:
        return outcome
    tracks = state.outlier_tracks.after_tracking(live.grey, image.grey, image.tracked.others)
    x = setup.camera.normalise(tracks.uv - late_px(setup.camera, tracks.uv, tracks.speed(live, image.time_ns)))
    frame = TrackedFrame(image.time_ns, tracks.ids[tracks.lasting], x[tracks.lasting], pose)
    agreeing = (outcome.tracked.status == TrackStatus.ALIVE) & np.isfinite(outcome.residual_px)
    test, moving = None, NO_TRACKS
    if not tracks.rest:
        test, moving = find_other_motion(local_map, frame, int(agreeing.sum()), setup.noise.width)
    if test is not None and test.passed:
        tracks = replace(tracks, rest=SEARCH_PAUSE)
    outcome = replace(
        outcome,
        decisions=outcome.decisions if test is None else (*outcome.decisions, test),
        outlier_tracks=tracks.explained(moving).joined(live, outcome.tracked, setup.max_tracks),
        other_motion=tracks.tracks(moving),
    )
    if len(moving) and setup.follow == "largest":
        return _follow_larger(setup, state, outcome, image, agreeing)
    return outcome


def _follow_larger(
    setup: Setup, state: ModernMonocularState, outcome: Outcome, image: NewImage, agreeing: NDArray[np.bool_]
) -> Outcome:
    """Starts a new map if the other motion covers more of the image than the inliers of the pose do, which are the
    live tracks of the mask `agreeing` (N,)."""
    live, tracked, pose = state.live, outcome.tracked, outcome.pose
    local_map = required(outcome.map, "the frame has no map")
    other = required(outcome.other_motion, "no other motion was searched")
    test = preferred(
        setup.follow,
        Moving(other.ids, other.uv, local_map.known(other.ids)),
        Moving(live.ids[agreeing], tracked.uv[agreeing], local_map.known(live.ids[agreeing])),
        (setup.camera.width, setup.camera.height),
    )
    decisions = (*outcome.decisions, test)
    if not test.passed:
        return replace(outcome, decisions=decisions)
    frame = replace(tracked_frame(setup.camera, live, tracked, image.time_ns), world_from_camera=pose)
    outcome = new_start(setup, state, tracked, frame, None, decisions)
    # Keyframes were static in another world than the one followed now.
    start = replace(required(outcome.start, "a new map has a start"), lost=None, before_loss=None)
    return replace(outcome, start=start, status=Status.INITIALISING, other_motion=other, restarted=not start.joined)


def find_other_motion(
    local_map: Map, frame: TrackedFrame, agreeing: int, width: float
) -> tuple[Decision | None, NDArray[np.int64]]:
    """Checks whether one other motion explains the outlier tracks of a frame; `agreeing` is the number of inliers.

    Returns the check, None for too few outliers, and the ids (M,) of the explained tracks, none if it passed. The
    tracks are compared with the keyframe that observes most of them; those consistent with a static point are excluded.
    `width` of the robust loss, normalised.
    """
    if len(frame.ids) < LEAST:
        return None, NO_TRACKS
    key = max(reversed(local_map.keys), key=frame.common)
    ids = moving_tracks(key, frame, frame.ids, MOVING * width)
    count = agreeing + len(ids)
    if not enough_outliers(len(ids), count):
        return None, NO_TRACKS
    explained = explained_by_motion(key.at(ids), frame.at(ids), width)
    test = second_motion_decision(explained, count)
    return test, NO_TRACKS if test.passed else ids[explained]


def check_agreement(
    setup: Setup, state: ModernMonocularState, outcome: Outcome, image: NewImage
) -> tuple[ModernMonocularState, Outcome]:
    """Adds the check of lasting points to the outcome of a localised frame, and takes a young map back if it fails.

    Tracks that contradict the map end, so that the inliers of a single frame are always many. The share of points that
    would agree for several frames is the product of the shares of these frames, as points also leave for other reasons
    (Kaplan and Meier 1958, Nonparametric estimation from incomplete observations).

    Also returns the state used: that before the map, if it is taken back.
    """
    if outcome.map is None or outcome.pose is None or state.map is None:
        return state, outcome
    status = outcome.tracked.status
    known = state.map.points.places(state.live.ids) >= 0
    agree = np.count_nonzero(known & (status == TrackStatus.ALIVE))
    contradict = np.count_nonzero(known & (status == TrackStatus.REPROJECTION))
    if agree + contradict:
        latest = agree / (agree + contradict), outcome.key_frame
        state = replace(state, agreeing=(*state.agreeing, latest)[-YOUNG_FRAMES:])
    if len(state.agreeing) == YOUNG_FRAMES:
        state = replace(state, before_map=None)
    test = checks.LASTING_POINTS.of(lasting_share(state.agreeing), MIN_LASTING_SHARE)
    before = state.before_map
    # A relocalised frame may have continued an older map.
    wrong = (
        before is not None
        and test.value < MIN_YOUNG_SHARE
        and outcome.map.keys[0].time_ns >= before.start.frames[0].time_ns
    )
    if before is not None and wrong:
        return _take_back(setup, state, before, outcome, image, test)
    return state, replace(outcome, decisions=(*outcome.decisions, test))


def lasting_share(agreeing: tuple[tuple[float, bool], ...]) -> float:
    """Returns the share of points that would agree for FRAMES frames, or KEYFRAMES keyframes."""
    share, keyframes = 1.0, 0
    for agree, key_frame in reversed(agreeing[-LASTING_FRAMES:]):
        keyframes += key_frame
        if keyframes > LASTING_KEYFRAMES:
            break
        share *= agree
    return share


def _take_back(
    setup: Setup, state: ModernMonocularState, before: BeforeMap, outcome: Outcome, image: NewImage, test: Decision
) -> tuple[ModernMonocularState, Outcome]:
    """Removes the map, its keyframes and all its poses, and starts the initialisation again from this frame.

    Poses of the map were reported, so a segment begins here. The frames before it keep their held poses at most.
    """
    frame = tracked_frame(setup.camera, state.live, outcome.tracked, image.time_ns)
    start, _ = before.start.restarted(frame, setup.noise.width)
    start = replace(start, earlier=(), passed=PersistentList(), joined=False, taken_back=True)
    settled = before.settled.extended(before.start.held)
    state = replace(state, settled=settled, database=before.database, loops=before.loops)
    test = replace(test, consequence="the map is taken back, and initialisation starts again from this frame")
    decisions = (*outcome.decisions, test)
    return state, Outcome(
        outcome.tracked, Status.INITIALISING, start.base, start=start, decisions=decisions, restarted=True
    )
