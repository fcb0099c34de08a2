"""The checks of loops."""

from __future__ import annotations

from ispom.types import Check

LOOP = "Seen before?"
LOOP_POINTS = Check(
    "loop_points",
    "points of an earlier place seen again",
    "finding",
    LOOP,
    passes="{value} points of an earlier place are seen again, {threshold} are enough.",
    fails="No earlier place: of those compared none shows more than {value} points again, {threshold} are needed.",
)
LOOP_VIEWS = Check(
    "loop_views",
    "views that tell of the same loop",
    "trigger",
    LOOP,
    passes="A loop: {value} views tell of the same one, {threshold} are enough.",
    fails="No loop yet: {value} views tell of this one, {threshold} are needed.",
)
LOOP_SHIFT = Check(
    "loop_shift",
    "shift of this pose by loops, of the way",
    "finding",
    LOOP,
    "<=",
    passes="The loop moves this pose by {value:.2%} of the way since; up to {threshold:.0%} is expected.",
    fails="The loop moves this pose by {value:.2%} of the way since, more than the {threshold:.0%} expected.",
)
LOOP_CHECKS = (LOOP_POINTS, LOOP_VIEWS, LOOP_SHIFT)
