"""The checks that several methods share: is this a keyframe?"""

from __future__ import annotations

from ispom.types import Check

KEY_FRAME = "New keyframe?"
PARALLAX = Check(
    "parallax",
    "parallax since the last keyframe",
    "trigger",
    KEY_FRAME,
    unit="deg",
    passes="New keyframe: parallax {value} deg (limit {threshold} deg).",
    fails="No keyframe: parallax {value} deg since the last one (keyframe from {threshold} deg).",
)
POINTS_LEFT = Check(
    "points_left",
    "share of the last keyframe's points still tracked",
    "trigger",
    KEY_FRAME,
    "<",
    passes="New keyframe: {value:.1%} of the last one's points are still tracked (limit {threshold:.0%}).",
    fails="No keyframe: {value:.0%} of the last one's points are still tracked (keyframe below {threshold:.0%}).",
)
