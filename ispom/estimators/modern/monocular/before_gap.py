"""Where frames are missing, the last one before the gap becomes a key frame: what follows is known by what it saw."""

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
"""Times the interval between the last two frames, from which on there is a gap: five frames or more are missing. Where
fewer are, as where a camera drops some, tracking loses little, and key frames would follow each other too closely."""


def remembered(setup: Setup, state: ModernMonocularState, time_ns: int) -> ModernMonocularState:
    """With the last frame as a key frame of the map, if the next one, at `time_ns`, comes after a gap.

    Tracks of the last second may have no place yet, as only a key frame gives them one, and few of them outlast the
    gap. The poses stay as they are until the next key frame adjusts them all.
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
