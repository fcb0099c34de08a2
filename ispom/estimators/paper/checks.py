"""The checks of the paper's methods, and the stages of their steps."""

from __future__ import annotations

from ispom.estimators.adjustment import BUNDLE_COST, COST, ITERATIONS
from ispom.estimators.key_frame_checks import KEY_FRAME, PARALLAX, POINTS_LEFT
from ispom.types import Check, by_key

TRIPLE, LOCATED = "Triple of key frames solved?", "Pair located?"
UNIT, CLOSED = "Unit kept?", "Segment follows the video?"

MONOCULAR_STAGES = {
    "track": "Follows the points into the new image (KLT), forward and backward.",
    "locate": "Gives the frame a pose at once, by resection from the last triple's points.",
    "key frame": "Decides on a key frame; with three of them: essential matrix of the outer two, forward intersection, "
    "resection of the middle one, unit handed on, frames between filled in.",
    "new points": "Looks for corners where points are missing, at key frames.",
}
STEREO_STAGES = {
    "correspond": "Finds the points of the last located left image in this one.",
    "left-right": "Matches the points in the right image: their disparities give the point cloud.",
    "motion": "Fits the rigid transformation between the two clouds, in RANSAC.",
}
INTEGRATED_STAGES = {
    "integrate": "At the end of a segment: scales and turns its video poses to fit both stereo poses.",
}
"""By their names in Step.seconds, in order."""

EPIPOLAR_SHARE = Check(
    "epipolar_share",
    "share of points on their epipolar lines",
    "requirement",
    TRIPLE,
    passes="The essential matrix explains {value:.0%} of the common points, {threshold:.0%} are needed.",
    fails="No triple: the essential matrix explains {value:.0%} of the common points, {threshold:.0%} are needed.",
)
RESECTED_POINTS = Check(
    "resected_points",
    "points resected in the middle key frame",
    "requirement",
    TRIPLE,
    passes="{value} points agree with the middle key frame's pose, {threshold} are needed.",
    fails="No triple: {value} points agree with the middle key frame's pose, {threshold} are needed.",
)
TRIPLE_POINTS = Check(
    "triple_points",
    "points common to three key frames",
    "requirement",
    TRIPLE,
    passes="The three key frames have {value} points in common, {threshold} are needed.",
    fails="The three key frames have {value} points in common, {threshold} are needed.",
)
SCALE_TRANSFER = Check(
    "scale_transfer",
    "scale transfer factor",
    "finding",
    UNIT,
    ">",
    passes="One unit of this triple is {value} units of the path.",
)
SCALE_SPREAD = Check(
    "scale_spread",
    "spread of the shared points' depth ratios",
    "warning",
    UNIT,
    "<=",
    "%",
    passes="The depths of shared points give it with a spread of {value} %; beyond {threshold} % it is marked.",
    fails="The depths of shared points give it with a spread of {value} %, more than {threshold} %.",
)
WAITING_FRAMES = Check(
    "waiting_frames",
    "frames since the last key frame",
    "finding",
    KEY_FRAME,
    "<=",
    passes="{value} frames wait for the next key frame, of at most {threshold}.",
    fails="{value} frames wait for the next key frame, more than {threshold}.",
)
OUTLIERS = Check(
    "outliers",
    "points dropped as outliers",
    "finding",
    "Which points disagree?",
    "<=",
    passes="Of {threshold} points {value} disagree with the pose, or lie off their epipolar lines, and are dropped.",
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
    passes="{value} points have a depth, {threshold} are needed.",
    fails="{value} points have a depth, {threshold} are needed.",
)
COMMON_POINTS = Check(
    "common_points",
    "points common with the last pair",
    "requirement",
    LOCATED,
    passes="{value} of them were in the last located pair, {threshold} are needed.",
    fails="{value} of them were in the last located pair, {threshold} are needed.",
)
RIGID_POINTS = Check(
    "rigid_points",
    "points that fit the rigid motion",
    "requirement",
    LOCATED,
    passes="Located: {value} points fit one rigid motion, {threshold} are needed.",
    fails="{value} points fit one rigid motion, {threshold} are needed.",
)
RIGID_OUTLIERS = Check(
    "outliers",
    "points that do not fit the rigid motion",
    "finding",
    "Which points disagree?",
    "<=",
    passes="Of {threshold} common points {value} do not fit the rigid motion, and start anew.",
)
STEREO = by_key(DEPTH_POINTS, COMMON_POINTS, RIGID_POINTS, RIGID_OUTLIERS)

VIDEO_COVERAGE = Check(
    "video_coverage",
    "video poses cover the segment",
    "requirement",
    CLOSED,
    passes="The video has poses all over the segment.",
    fails="The video's poses cannot be used in this segment.",
)
SEGMENT_LENGTH = Check(
    "segment_length",
    "segment length",
    "finding",
    CLOSED,
    unit="m",
    passes="The segment is {value} m long, {threshold} are enough for a ratio of lengths.",
    fails="The segment is {value} m long; a ratio of lengths takes {threshold}, and a video path that moves.",
)
SCALE_RATIO = Check(
    "scale_ratio",
    "scale ratio",
    "finding",
    CLOSED,
    ">",
    "m per unit",
    passes="Scale: one unit of the video's path is {value} m in this segment.",
)
SCALE_CHANGE = Check(
    "scale_change",
    "scale ratio against the segment before",
    "warning",
    CLOSED,
    "<=",
    "%",
    passes="That is {value} % off the ratio of the segment before; more than {threshold} % is doubtful.",
    fails="That is {value} % off the ratio of the segment before: doubtful, beyond {threshold} %.",
)
SEGMENT_TURN = Check(
    "segment_turn",
    "segment vector turned by",
    "warning",
    CLOSED,
    "<=",
    "deg",
    passes="Rotation: its vector was turned by {value} degrees to meet stereo's; more than {threshold} is doubtful.",
    fails="Rotation: its vector was turned by {value} degrees to meet stereo's: doubtful, beyond {threshold}.",
)
END_ORIENTATION = Check(
    "end_orientation",
    "last orientation missed by",
    "warning",
    CLOSED,
    "<=",
    "deg",
    passes="Residual: its last orientation missed stereo's by {value} degrees, which are spread over the segment.",
    fails="Residual: its last orientation missed stereo's by {value} degrees: doubtful, beyond {threshold}.",
)
OPEN_FRAMES = Check(
    "open_frames",
    "video frames since the last pair",
    "requirement",
    relation="<=",
    passes="{value} video frames wait for a pair, of at most {threshold}.",
    fails="{value} video frames wait for a pair, more than {threshold} are not kept.",
)
INTEGRATED = by_key(
    VIDEO_COVERAGE, SEGMENT_LENGTH, SCALE_RATIO, SCALE_CHANGE, SEGMENT_TURN, END_ORIENTATION, OPEN_FRAMES
)
