"""Checks for how long points agree with the map: those of a wrong map, or of moving water, soon contradict it. A young
map that most points contradict is taken back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.setup import Setup
from ispom.estimators.modern.monocular.state import BeforeMap, ModernMonocularState, NewImage, Outcome
from ispom.estimators.modern.monocular.tracks import tracked_frame
from ispom.persistent_list import PersistentList
from ispom.types import Decision, Status, TrackStatus

FRAMES, KEYFRAMES = 10, 3
"""Number of frames for which points should agree, or of keyframes if these come sooner: with wide steps, each frame
adds as much parallax, and as much error, as several others do."""
LASTING = 2 / 3
"""Least share of the points that agree for that long. In five of six simulations of water it falls to 0.35 to 0.63
within 30 frames; the sixth moves too much like a rigid scene. Before static walls it is 0.99, also with cards that
move independently on half of the image."""
RIGHT = 1 / 3
"""The same for a young map: with less, twice as many points contradict it as agree, and it is taken back. First maps
with random depths (factors of 3.3 and 7.4 at 1 sigma) fall to 0.27 and 0.01; with 2.2 the share fell to 0.58 only, and
the map recovered. Chosen with hard/realsense_office, too, where blurred images of a turning camera leave 0.39: with 1/2
that map was taken back, and none was made for 130 frames."""
YOUNG = 20
"""Number of localised frames for which a map is young: a wrong one shows in the first keyframes after it, and poses of
more frames would be lost with it."""


def with_agreement(
    setup: Setup, state: ModernMonocularState, outcome: Outcome, new: NewImage
) -> tuple[ModernMonocularState, Outcome]:
    """Adds the check of lasting points to the outcome of a localised frame, and takes a young map back if it fails.

    Tracks that contradict the map end, so that the inliers of a single frame are always many. The share of points that
    would agree for several frames is the product of the shares of these frames, as points also leave for other reasons
    (Kaplan and Meier 1958, Nonparametric estimation from incomplete observations).

    Also returns the state used: that before the map, if it is taken back.
    """
    if outcome.map is None or outcome.pose is None or state.map is None:
        return state, outcome
    status = outcome.followed.status
    known = state.map.points.places(state.live.ids) >= 0
    agree = np.count_nonzero(known & (status == TrackStatus.ALIVE))
    contradict = np.count_nonzero(known & (status == TrackStatus.REPROJECTION))
    if agree + contradict:
        latest = agree / (agree + contradict), outcome.key_frame
        state = replace(state, agreeing=(*state.agreeing, latest)[-YOUNG:])
    if len(state.agreeing) == YOUNG:
        state = replace(state, before_map=None)
    test = checks.LASTING_POINTS.of(lasting_share(state.agreeing), LASTING)
    before = state.before_map
    # A relocalised frame may have continued an older map.
    wrong = before is not None and test.value < RIGHT and outcome.map.keys[0].time_ns >= before.start.frames[0].time_ns
    if before is not None and wrong:
        return _taken_back(setup, state, before, outcome, new, test)
    return state, replace(outcome, decisions=(*outcome.decisions, test))


def lasting_share(agreeing: tuple[tuple[float, bool], ...]) -> float:
    """Returns the share of points that would agree for FRAMES frames, or KEYFRAMES keyframes."""
    share, keyframes = 1.0, 0
    for agree, key_frame in reversed(agreeing[-FRAMES:]):
        keyframes += key_frame
        if keyframes > KEYFRAMES:
            break
        share *= agree
    return share


def _taken_back(
    setup: Setup, state: ModernMonocularState, before: BeforeMap, outcome: Outcome, new: NewImage, test: Decision
) -> tuple[ModernMonocularState, Outcome]:
    """Removes the map, its keyframes and all its poses, and starts the initialisation again from this frame.

    Poses of the map were reported, so a segment begins here. The frames before it keep their held poses at most.
    """
    frame = tracked_frame(setup.camera, state.live, outcome.followed, new.time_ns)
    start, _ = before.start.restarted(frame, setup.noise.width)
    start = replace(start, earlier=(), passed=PersistentList(), joined=False, taken_back=True)
    settled = before.settled.extended(before.start.held)
    state = replace(state, settled=settled, database=before.database, loops=before.loops)
    test = replace(test, consequence="the map is taken back, and initialisation starts again from this frame")
    decisions = (*outcome.decisions, test)
    return state, Outcome(
        outcome.followed, Status.INITIALISING, start.base, start=start, decisions=decisions, restarted=True
    )
