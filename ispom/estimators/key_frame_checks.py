"""The checks that several methods share: is this a key frame?"""

from __future__ import annotations

from ispom.types import Check

KEY_FRAME = "New key frame?"
PARALLAX = Check(
    "parallax",
    "parallax since the last key frame",
    "trigger",
    KEY_FRAME,
    unit="deg",
    passes="Key frame: moved {value} degrees, {threshold} are enough.",
    fails="No reason for a key frame: moved {value} of {threshold} degrees.",
)
POINTS_LEFT = Check(
    "points_left",
    "share of the last key frame's points left",
    "trigger",
    KEY_FRAME,
    "<",
    passes="Key frame: {value:.0%} of the last one's points are left, less than {threshold:.0%}.",
    fails="No reason for a key frame: {value:.0%} of the last one's points are left, {threshold:.0%} are enough.",
)
