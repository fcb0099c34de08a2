"""Key frames "which have large displacement but still have enough feature points" (section 6.1)."""

from __future__ import annotations

from ispom.estimators.paper import checks
from ispom.estimators.paper.monocular.window import MAX_WAITING, KeyFrameWindow
from ispom.estimators.tracked_frame import TrackedFrame, parallax_deg
from ispom.types import Decision

TELLING_SHARE = 0.25
"""Of the parallax wanted: with less a frame is no key frame, however few points are left."""


def key_frame_tests(
    window: KeyFrameWindow, frame: TrackedFrame, min_parallax_deg: float, min_share: float, limit: float
) -> tuple[bool, tuple[Decision, ...]]:
    """Whether the frame is a key frame, and why. `limit`: largest error of a track, normalised."""
    if not window.keys:
        return True, ()
    last = window.keys[-1]
    displacement = parallax_deg(last, frame, limit)
    share = last.common(frame) / max(len(last.ids), 1)
    moved = checks.PARALLAX.of(displacement, min_parallax_deg)
    few, telling = share < min_share, displacement >= TELLING_SHARE * min_parallax_deg
    why = "too little parallax for a keyframe" if few and not telling else ""
    early = checks.POINTS_LEFT.of(share, min_share, why, few and telling)
    waiting = sum(f.time_ns > last.time_ns for f in window.frames)
    given_up = checks.WAITING_FRAMES.of(waiting + 1, MAX_WAITING, "the oldest keep their first poses")
    tests = (moved, early) if given_up.passed else (moved, early, given_up)
    return moved.passed or early.passed, tests
