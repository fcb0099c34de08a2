"""Makes the last frame before a gap in the video a keyframe, so that later frames can be matched with it."""

from __future__ import annotations

from dataclasses import replace

from ispom.estimators.modern.keyframe_database import Keyframe
from ispom.estimators.modern.monocular.key_frame import with_key_frame
from ispom.estimators.modern.monocular.marginalise import shortened
from ispom.estimators.modern.monocular.setup import Setup
from ispom.estimators.modern.monocular.state import ModernMonocularState
from ispom.estimators.modern.monocular.tracks import moving, unrolled
from ispom.estimators.tracked_frame import TrackedFrame

MISSING = 5.5
"""Ratio of the frame interval to the one before, from which there is a gap: at least five frames are missing. For
shorter gaps, as where a camera drops frames, tracking loses little, and keyframes would be too frequent."""


def remembered(setup: Setup, state: ModernMonocularState, time_ns: int) -> ModernMonocularState:
    """Adds the last frame to the map as a keyframe if the next frame, at `time_ns`, comes after a gap.

    Tracks of the last second may be untriangulated, as only keyframes add points, and few of them survive the gap. The
    poses are not changed until the next keyframe optimises them all.
    """
    world, live = state.map, state.live
    if world is None or live.grey is None or state.missed:
        return state
    (before_ns, _), (last_ns, last) = state.recent[0], state.recent[-1]
    gap = time_ns - last_ns > MISSING * (last_ns - before_ns) > 0
    if not gap or live.time_ns != last_ns or world.keys[-1].time_ns == last_ns:
        return state
    frame = TrackedFrame(last_ns, live.ids, setup.camera.normalise(unrolled(setup.camera, live)), last)
    others = tuple(b for b in world.relative_frames if b.time_ns != last_ns)
    world = with_key_frame(setup, replace(world, relative_frames=others), frame).map
    world, settled = shortened(world, live.ids, setup.key_frames)
    moved = moving(setup.camera, live.uv, live.speed)
    database = state.database.with_keyframe(
        Keyframe.of(last_ns, last.inverse(), (live.grey,), state.covariance, moving=moved, segment=state.segment)
    )
    return replace(state, map=world, settled=state.settled.extended(settled), database=database)
