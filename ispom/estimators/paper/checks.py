"""The checks of the paper's methods, and the stages of their steps."""

from __future__ import annotations

from ispom.estimators.adjustment import BUNDLE_COST, COST, ITERATIONS
from ispom.estimators.key_frame_checks import KEY_FRAME, PARALLAX, POINTS_LEFT
from ispom.types import Check, by_key

TRIPLE, LOCATED = "Triple of keyframes solved?", "Pair localised?"
UNIT, CLOSED = "Is the scale reliable?", "Segment follows the video?"

MONOCULAR_STAGES = {
    "track": "Tracks features into the new image (KLT), forward and backward.",
    "locate": "Pose from 2D-3D matches (PnP) with the points of the last triple.",
    "key frame": "Decides on a keyframe; with three of them: essential matrix of the outer two, triangulation, "
    "resection of the middle one, scale transfer, interpolation of the frames between.",
    "new points": "Detects new corners at keyframes, where tracks are missing.",
}
STEREO_STAGES = {
    "correspond": "Matches the points of the last localised left image in this one.",
    "left-right": "Matches the points in the right image: their disparities give the point cloud.",
    "motion": "Fits the rigid transformation between the two point clouds (RANSAC).",
}
INTEGRATED_STAGES = {
    "integrate": "At the end of a segment: scales and rotates its video poses to fit both stereo poses.",
}
"""By their names in Step.seconds, in order."""

EPIPOLAR_SHARE = Check(
    "epipolar_share",
    "share of epipolar inliers",
    "requirement",
    TRIPLE,
    passes="Essential matrix: {value:.0%} of the common points are inliers ({threshold:.0%} needed).",
    fails="No triple: {value:.0%} of the common points are inliers of the essential matrix ({threshold:.0%} needed).",
)
RESECTED_POINTS = Check(
    "resected_points",
    "inliers of the middle keyframe's pose",
    "requirement",
    TRIPLE,
    passes="Triple solved: {value} inliers of the middle keyframe's pose ({threshold} needed).",
    fails="No triple: {value} inliers of the middle keyframe's pose ({threshold} needed).",
)
TRIPLE_POINTS = Check(
    "triple_points",
    "points common to three keyframes",
    "requirement",
    TRIPLE,
    passes="Three keyframes share {value} points ({threshold} needed).",
    fails="Lost: three keyframes share {value} points ({threshold} needed).",
    topic="pose",
)
SCALE_TRANSFER = Check(
    "scale_transfer",
    "scale transfer factor",
    "finding",
    UNIT,
    ">",
    passes="Scale transfer: one unit of this triple is {value} units of the path.",
)
SCALE_SPREAD = Check(
    "scale_spread",
    "scatter of the depth ratios of shared points",
    "warning",
    UNIT,
    "<=",
    "%",
    passes="Scale transfer: depth ratios of shared points scatter by {value} % (limit {threshold} %).",
    fails="Scale unreliable: depth ratios of shared points scatter by {value} % (limit {threshold} %).",
    topic="scale",
)
WAITING_FRAMES = Check(
    "waiting_frames",
    "frames since the last keyframe",
    "finding",
    KEY_FRAME,
    "<=",
    passes="{value} frames wait for the next keyframe (maximum {threshold}).",
    fails="{value} frames wait for the next keyframe, more than {threshold}.",
)
OUTLIERS = Check(
    "outliers",
    "points dropped as outliers",
    "finding",
    "Which points are outliers?",
    "<=",
    passes="Outliers: {value} of {threshold} points dropped.",
)
MONOCULAR = by_key(
    PARALLAX,
    POINTS_LEFT,
    EPIPOLAR_SHARE,
    RESECTED_POINTS,
    TRIPLE_POINTS,
    SCALE_TRANSFER,
    SCALE_SPREAD,
    BUNDLE_COST,
    COST,
    ITERATIONS,
    WAITING_FRAMES,
    OUTLIERS,
)

DEPTH_POINTS = Check(
    "depth_points",
    "points with depth",
    "requirement",
    LOCATED,
    passes="{value} points have a depth ({threshold} needed).",
    fails="Too few depths: {value} points have a depth ({threshold} needed).",
    topic="pose",
)
COMMON_POINTS = Check(
    "common_points",
    "points matched with the last pair",
    "requirement",
    LOCATED,
    passes="{value} points match the last localised pair ({threshold} needed).",
    fails="Lost: {value} points match the last localised pair ({threshold} needed).",
    topic="pose",
)
RIGID_POINTS = Check(
    "rigid_points",
    "inliers of the rigid motion",
    "requirement",
    LOCATED,
    passes="Tracking: {value} inliers of one rigid motion (minimum {threshold}).",
    fails="Lost: {value} inliers of one rigid motion ({threshold} needed).",
    topic="pose",
)
RIGID_OUTLIERS = Check(
    "outliers",
    "outliers of the rigid motion",
    "finding",
    "Which points are outliers?",
    "<=",
    passes="Outliers: {value} of {threshold} common points do not fit the rigid motion.",
)
STEREO = by_key(DEPTH_POINTS, COMMON_POINTS, RIGID_POINTS, RIGID_OUTLIERS)

VIDEO_COVERAGE = Check(
    "video_coverage",
    "video poses cover the segment",
    "requirement",
    CLOSED,
    passes="The video has poses in the whole segment.",
    fails="Video unusable: its poses do not cover this segment.",
)
SEGMENT_LENGTH = Check(
    "segment_length",
    "segment length",
    "finding",
    CLOSED,
    unit="m",
    passes="Segment length {value} m (the scale needs {threshold} m).",
    fails="No scale: the segment is {value} m long (the scale needs {threshold} m and a video path that moves).",
)
SCALE_RATIO = Check(
    "scale_ratio",
    "scale ratio",
    "finding",
    CLOSED,
    ">",
    "m per unit",
    passes="Scale: one unit of the video is {value} m in this segment.",
)
SCALE_CHANGE = Check(
    "scale_change",
    "change of the scale ratio from the segment before",
    "warning",
    CLOSED,
    "<=",
    "%",
    passes="Scale: {value} % different from the segment before (limit {threshold} %).",
    fails="Scale unreliable: {value} % different from the segment before (limit {threshold} %).",
    topic="scale",
)
SEGMENT_TURN = Check(
    "segment_turn",
    "rotation of the segment vector",
    "warning",
    CLOSED,
    "<=",
    "deg",
    passes="Rotation: the segment was rotated by {value} deg onto stereo's (limit {threshold} deg).",
    fails="Rotation doubtful: the segment was rotated by {value} deg onto stereo's (limit {threshold} deg).",
)
END_ORIENTATION = Check(
    "end_orientation",
    "error of the last orientation",
    "warning",
    CLOSED,
    "<=",
    "deg",
    passes="Residual: the last orientation differs from stereo's by {value} deg (limit {threshold} deg).",
    fails="Rotation doubtful: the last orientation differs from stereo's by {value} deg (limit {threshold} deg).",
)
OPEN_FRAMES = Check(
    "open_frames",
    "video frames since the last pair",
    "requirement",
    relation="<=",
    passes="{value} video frames wait for a stereo pair (maximum {threshold}).",
    fails="Waiting too long: {value} video frames since the last stereo pair (maximum {threshold}).",
)
INTEGRATED = by_key(
    VIDEO_COVERAGE, SEGMENT_LENGTH, SCALE_RATIO, SCALE_CHANGE, SEGMENT_TURN, END_ORIENTATION, OPEN_FRAMES
)
