"""Tries to localise lost frames again, because keyframes that were added since may show the same points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.errors import required
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.recover import relocalise_alone
from ispom.estimators.modern.monocular.setup import Setup
from ispom.estimators.modern.monocular.state import LostFrame, ModernMonocularState, Outcome
from ispom.estimators.modern.monocular.tracks import NewImage, TrackingResult
from ispom.geometry import Pose
from ispom.types import Status

MAX_LOST = 16
"""Largest number of lost frames that are kept, the newest ones: their images take 16 MB at most."""
AT_A_TIME = 2
"""Number of lost frames that are tried per keyframe, the newest ones first: each takes as long as a relocalisation."""
TRIES = 4
"""Number of keyframes at which a lost frame is tried, each time against the newest keyframe and some others."""
NO_TRACKS = TrackingResult(np.zeros((0, 2), np.float32), np.zeros(0, np.uint8), np.zeros((0, 2), np.float32))


def next_lost_frames(
    setup: Setup, state: ModernMonocularState, outcome: Outcome, image: NewImage
) -> tuple[LostFrame, ...]:
    """Returns the frames to try later, without those of a segment that begins; adds this one if it has no pose."""
    since = outcome.segment_from_ns
    waiting = tuple(f for f in state.lost_frames if since is None or f.time_ns < since)
    lost = outcome.pose is None and (outcome.status == Status.LOST or outcome.start is not None)
    if not lost or not setup.relocalise:
        return waiting
    return (*waiting, LostFrame(image.time_ns, image.grey, state.segment))[-MAX_LOST:]


def try_lost_frames(
    setup: Setup, state: ModernMonocularState, outcome: Outcome
) -> tuple[ModernMonocularState, Outcome]:
    """Localises some of the lost frames at a keyframe, each in the segment in which it was lost.

    Also returns the state used, which has new descriptions of keyframes, and no frame that was localised.
    """
    local_map = outcome.map
    if not outcome.key_frame or local_map is None or not state.lost_frames:
        return state, outcome
    waiting, found = state.lost_frames[:-AT_A_TIME], list[tuple[int, Pose]]()
    for frame in state.lost_frames[: -AT_A_TIME - 1 : -1]:
        state, pose = localise_lost_frame(setup, state, local_map, frame)
        if pose is not None:
            found.append((frame.time_ns, pose))
        elif frame.tries + 1 < TRIES:  # after all others, at a later keyframe
            waiting = (replace(frame, tries=frame.tries + 1), *waiting)
    return replace(state, lost_frames=waiting), replace(outcome, settled=(*outcome.settled, *found))


def found_at_the_end(setup: Setup, state: ModernMonocularState) -> tuple[tuple[int, Pose], ...]:
    """Returns the poses of those of the lost frames that the keyframes of the whole run localise."""
    local_map, found = state.map, list[tuple[int, Pose]]()
    for frame in state.lost_frames if local_map is not None else ():
        for tries in range(frame.tries, TRIES):
            state, pose = localise_lost_frame(setup, state, required(local_map, "no map"), replace(frame, tries=tries))
            if pose is not None:
                found.append((frame.time_ns, pose))
                break
    return tuple(found)


def localise_lost_frame(
    setup: Setup, state: ModernMonocularState, local_map: Map, frame: LostFrame
) -> tuple[ModernMonocularState, Pose | None]:
    """Localises a lost frame among the keyframes; None if it does not match one of its segment."""
    image = NewImage(frame.time_ns, frame.grey, None, NO_TRACKS, np.zeros((0, 3)))
    described, relocalisation = relocalise_alone(setup, state, local_map, image, frame.tries)
    state = replace(state, database=described.database)
    if relocalisation is None or relocalisation.segment != frame.segment:
        return state, None
    fit = relocalisation.localisation.fit
    return state, None if fit is None else fit.camera_from_world.inverse()
