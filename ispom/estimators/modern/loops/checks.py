"""The checks of loop closures."""

from __future__ import annotations

from ispom.types import Check

LOOP = "Loop closure?"
LOOP_POINTS = Check(
    "loop_points",
    "points matched with an earlier keyframe",
    "finding",
    LOOP,
    passes="{value} points match an earlier keyframe ({threshold} needed).",
    fails="No loop: the best of the earlier keyframes compared matches {value} points ({threshold} needed).",
)
LOOP_VIEWS = Check(
    "loop_views",
    "keyframes that confirm the same loop",
    "trigger",
    LOOP,
    passes="Loop closure: {value} keyframes confirm the same loop ({threshold} needed).",
    fails="No loop closure yet: {value} keyframes confirm this loop ({threshold} needed).",
    topic="loop",
)
LOOP_SHIFT = Check(
    "loop_shift",
    "correction of this pose by the loop, relative to the path",
    "finding",
    LOOP,
    "<=",
    passes="The loop closure corrects this pose by {value:.2%} of the path since (expected: up to {threshold:.0%}).",
    fails="The loop closure corrects this pose by {value:.2%} of the path since (expected: up to {threshold:.0%}).",
)
LOOP_ASKED = Check(
    "loop_asked",
    "loop as asked",
    "trigger",
    LOOP,
    passes="Loop closure as asked: the setting accept_loops has it, whatever other rules say.",
    fails="No loop closure as asked: the setting refuse_loops has it.",
    topic="loop",
)
LOOP_CHECKS = (LOOP_POINTS, LOOP_VIEWS, LOOP_SHIFT, LOOP_ASKED)
