"""The checks of the stereo method, and the stages of a step."""

from __future__ import annotations

from ispom.estimators.adjustment import ADJUSTED, COST, ITERATIONS, WINDOW
from ispom.estimators.key_frame_checks import KEY_FRAME, POINTS_LEFT
from ispom.estimators.modern.loops.checks import LOOP_CHECKS
from ispom.types import Check, by_key

LOCATED, CALIBRATED = "Pair located?", "Is the calibration right?"

STAGES = {
    "track": "Follows the points into the left image, then into the right one, and locates the pair by both.",
    "new points": "Key frame: looks for corners between the points and matches them in the right image.",
    "adjust": "Adjusts the window of key frames, their points and the pair's calibration; the oldest becomes a prior.",
    "conclude": "Collects what the next pair starts from, and this report.",
    "loops": "Looks for earlier places, where that is wanted, and tells poses anew once one was found.",
}
"""By their names in Step.seconds, in order."""

GUIDED_POINTS = Check(
    "guided_points",
    "points found where the motion leads",
    "trigger",
    LOCATED,
    passes="Located: {value} points were found where the motion leads, {threshold} are enough.",
    fails="{value} points were found where the motion leads; with fewer than {threshold} other ways are tried.",
)
NEARBY_POINTS = Check(
    "nearby_points",
    "points found around their last places",
    "trigger",
    LOCATED,
    passes="Located: {value} points were found around their last places, {threshold} are enough.",
    fails="{value} points were found around their last places; with fewer than {threshold} descriptors are compared.",
)
DESCRIBED_POINTS = Check(
    "described_points",
    "points found by descriptors",
    "requirement",
    LOCATED,
    passes="Located: {value} points were found with the help of descriptors, {threshold} are needed.",
    fails="Not located: {value} points were found, with descriptors as well; {threshold} are needed.",
)
DEPTH_POINTS = Check(
    "depth_points",
    "points with depth",
    "requirement",
    "New start?",
    passes="{value} points have a depth, {threshold} are needed.",
    fails="No start: {value} points have a depth, {threshold} are needed.",
)
LOST_PAIRS = Check(
    "lost_pairs",
    "pairs lost",
    "requirement",
    LOCATED,
    "<=",
    passes="{value} pairs in a row were not located, {threshold} are waited for.",
    fails="{value} pairs in a row were not located; no more than {threshold} are waited for.",
)
DISPLACEMENT = Check(
    "displacement",
    "median displacement since the last key frame",
    "trigger",
    KEY_FRAME,
    unit="px",
    passes="Key frame: the points moved {value} px, {threshold} are enough.",
    fails="No reason for a key frame: the points moved {value} of {threshold} px.",
)
ADJUSTED_ERROR = Check(
    "adjusted_error",
    "median error after adjustment",
    "warning",
    ADJUSTED,
    "<=",
    "px",
    passes="Half of the observations lie within {value} px of their points; up to {threshold} px is usual.",
    fails="Half of the observations lie more than {value} px from their points; up to {threshold} px is usual.",
)
OUTLIERS = Check(
    "outliers",
    "observations dropped by the adjustment",
    "finding",
    ADJUSTED,
    "<=",
    passes="Of {threshold} observations {value} are too far from their points, and are dropped.",
)
OFFSET = Check(
    "disparity_offset",
    "disparity offset",
    "finding",
    CALIBRATED,
    ">",
    "px",
    passes="The right image is off by {value} px in the middle: significant, as 2 sigma are {threshold}.",
    fails="The right image is off by {value} px in the middle: not significant, as 2 sigma are {threshold}.",
)
BEND = Check(
    "disparity_bend",
    "disparity offset at 27 degrees against the middle",
    "finding",
    CALIBRATED,
    ">",
    "px",
    passes="27 degrees to the side it is off by {value} px more: significant, as 2 sigma are {threshold}.",
    fails="27 degrees to the side it is off by {value} px more: not significant, as 2 sigma are {threshold}.",
)
SHUTTER_LAG = Check(
    "shutter_lag",
    "right shutter late by",
    "finding",
    CALIBRATED,
    ">",
    "ms",
    passes="The right shutter is {value} ms late: significant, as 2 sigma are {threshold}.",
    fails="The right shutter is {value} ms late: not significant, as 2 sigma are {threshold}.",
)

CHECKS = by_key(
    GUIDED_POINTS,
    NEARBY_POINTS,
    DESCRIBED_POINTS,
    DEPTH_POINTS,
    LOST_PAIRS,
    DISPLACEMENT,
    POINTS_LEFT,
    ADJUSTED_ERROR,
    COST,
    ITERATIONS,
    OUTLIERS,
    WINDOW,
    OFFSET,
    BEND,
    SHUTTER_LAG,
    *LOOP_CHECKS,
)
