"""The checks of the paper's methods."""

from __future__ import annotations

from ispom.estimators.check import Check, by_key

KEY_FRAME, TRIPLE, LOCATED = "New key frame?", "Triple of key frames solved?", "Pair located?"
CLOSED = "Segment follows the video?"

PARALLAX = Check("parallax", "parallax since the last key frame", "trigger", KEY_FRAME, unit="deg")
POINTS_LEFT = Check("points-left", "share of the last key frame's points left", "trigger", KEY_FRAME, "<")
EPIPOLAR_SHARE = Check("epipolar-share", "share of points on their epipolar lines", "requirement", TRIPLE)
RESECTED_POINTS = Check("resected-points", "points resected in the middle key frame", "requirement", TRIPLE)
TRIPLE_POINTS = Check("triple-points", "points common to three key frames", "requirement", TRIPLE)
SCALE_TRANSFER = Check("scale-transfer", "scale transfer factor", "finding", relation=">")
BUNDLE_COST = Check("bundle-cost", "bundle cost, after / before", "finding", relation="<")
WAITING_FRAMES = Check("waiting-frames", "frames since the last key frame", "finding", relation="<=")
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

DEPTH_POINTS = Check("depth-points", "points with depth", "requirement", LOCATED)
COMMON_POINTS = Check("common-points", "points common with the last pair", "requirement", LOCATED)
RIGID_POINTS = Check("rigid-points", "points that fit the rigid motion", "requirement", LOCATED)
STEREO = by_key(DEPTH_POINTS, COMMON_POINTS, RIGID_POINTS)

VIDEO_COVERAGE = Check("video-coverage", "video poses cover the segment", "requirement", CLOSED)
SEGMENT_LENGTH = Check("segment-length", "segment length", "finding", CLOSED, unit="m")
SCALE_RATIO = Check("scale-ratio", "scale ratio", "finding", relation=">", unit="m per unit")
SEGMENT_TURN = Check("segment-turn", "segment vector turned by", "finding", relation="<=", unit="deg")
END_ORIENTATION = Check("end-orientation", "last orientation missed by", "finding", relation="<=", unit="deg")
OPEN_FRAMES = Check("open-frames", "video frames since the last pair", "requirement", relation="<=")
INTEGRATED = by_key(VIDEO_COVERAGE, SEGMENT_LENGTH, SCALE_RATIO, SEGMENT_TURN, END_ORIENTATION, OPEN_FRAMES)
