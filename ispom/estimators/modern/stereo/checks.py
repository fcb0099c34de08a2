"""The checks of the stereo method."""

from __future__ import annotations

from ispom.types import Check, by_key

LOCATED, KEY_FRAME = "Pair located?", "New key frame?"

GUIDED_POINTS = Check("guided_points", "points found where the motion leads", "trigger", LOCATED)
NEARBY_POINTS = Check("nearby_points", "points found around their last places", "trigger", LOCATED)
DESCRIBED_POINTS = Check("described_points", "points found by descriptors", "requirement", LOCATED)
DEPTH_POINTS = Check("depth_points", "points with depth", "requirement", "New start?")
LOST_PAIRS = Check("lost_pairs", "pairs lost", "requirement", LOCATED, "<=")
DISPLACEMENT = Check("displacement", "median displacement since the last key frame", "trigger", KEY_FRAME, unit="px")
POINTS_LEFT = Check("points_left", "share of the last key frame's points left", "trigger", KEY_FRAME, "<")
ADJUSTED_ERROR = Check("adjusted_error", "median error after adjustment", "finding", relation="<=", unit="px")
OFFSET = Check("disparity_offset", "disparity offset", "finding", relation=">", unit="px")
BEND = Check("disparity_bend", "disparity offset at 27 degrees against the middle", "finding", relation=">", unit="px")
SHUTTER_LAG = Check("shutter_lag", "right shutter late by", "finding", relation=">", unit="ms")

CHECKS = by_key(
    GUIDED_POINTS,
    NEARBY_POINTS,
    DESCRIBED_POINTS,
    DEPTH_POINTS,
    LOST_PAIRS,
    DISPLACEMENT,
    POINTS_LEFT,
    ADJUSTED_ERROR,
    OFFSET,
    BEND,
    SHUTTER_LAG,
)
