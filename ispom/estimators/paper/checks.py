"""The checks of the paper's methods."""

from __future__ import annotations

from ispom.types import Check, by_key

KEY_FRAME, TRIPLE, LOCATED = "New key frame?", "Triple of key frames solved?", "Pair located?"
CLOSED = "Segment follows the video?"

PARALLAX = Check("parallax", "parallax since the last key frame", "trigger", KEY_FRAME, unit="deg")
POINTS_LEFT = Check("points_left", "share of the last key frame's points left", "trigger", KEY_FRAME, "<")
EPIPOLAR_SHARE = Check("epipolar_share", "share of points on their epipolar lines", "requirement", TRIPLE)
RESECTED_POINTS = Check("resected_points", "points resected in the middle key frame", "requirement", TRIPLE)
TRIPLE_POINTS = Check("triple_points", "points common to three key frames", "requirement", TRIPLE)
SCALE_TRANSFER = Check("scale_transfer", "scale transfer factor", "finding", relation=">")
BUNDLE_COST = Check("bundle_cost", "bundle cost, after / before", "finding", relation="<")
WAITING_FRAMES = Check("waiting_frames", "frames since the last key frame", "finding", relation="<=")
MONOCULAR = by_key(
    PARALLAX,
    POINTS_LEFT,
    EPIPOLAR_SHARE,
    RESECTED_POINTS,
    TRIPLE_POINTS,
    SCALE_TRANSFER,
    BUNDLE_COST,
    WAITING_FRAMES,
)

DEPTH_POINTS = Check("depth_points", "points with depth", "requirement", LOCATED)
COMMON_POINTS = Check("common_points", "points common with the last pair", "requirement", LOCATED)
RIGID_POINTS = Check("rigid_points", "points that fit the rigid motion", "requirement", LOCATED)
STEREO = by_key(DEPTH_POINTS, COMMON_POINTS, RIGID_POINTS)

VIDEO_COVERAGE = Check("video_coverage", "video poses cover the segment", "requirement", CLOSED)
SEGMENT_LENGTH = Check("segment_length", "segment length", "finding", CLOSED, unit="m")
SCALE_RATIO = Check("scale_ratio", "scale ratio", "finding", relation=">", unit="m per unit")
SEGMENT_TURN = Check("segment_turn", "segment vector turned by", "finding", relation="<=", unit="deg")
END_ORIENTATION = Check("end_orientation", "last orientation missed by", "finding", relation="<=", unit="deg")
OPEN_FRAMES = Check("open_frames", "video frames since the last pair", "requirement", relation="<=")
INTEGRATED = by_key(VIDEO_COVERAGE, SEGMENT_LENGTH, SCALE_RATIO, SEGMENT_TURN, END_ORIENTATION, OPEN_FRAMES)
