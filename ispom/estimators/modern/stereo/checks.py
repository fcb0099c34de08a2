"""The checks of the stereo method, and the stages of a step."""

from __future__ import annotations

from ispom.estimators.adjustment import ADJUSTED, COST, ITERATIONS, WINDOW
from ispom.estimators.key_frame_checks import KEY_FRAME, POINTS_LEFT
from ispom.estimators.modern.loops.checks import LOOP_CHECKS
from ispom.estimators.modern.noise import NOISE
from ispom.estimators.modern.second_motion import LARGER, SECOND_MOTION, WIDER
from ispom.types import Check, by_key

LOCATED, CALIBRATED, LEVEL = "Pair localised?", "Is the calibration right?", "Is the pair level?"

STAGES = {
    "track": "Tracks the points into the left image and then into the right one, and estimates the pose from both.",
    "other motion": "Moving objects: checks whether rejected tracks move together as one rigid object.",
    "new points": "Keyframe: detects new corners and matches them in the right image.",
    "adjust": "Optimises the window of keyframes, their points and the calibration; marginalises the oldest keyframe.",
    "conclude": "Bookkeeping.",
    "loops": "Loop closure: looks for earlier keyframes that show the same scene, and corrects the poses.",
}
"""Descriptions of the stages, in order; the keys are those of Step.seconds."""

GUIDED_POINTS = Check(
    "guided_points",
    "points matched where the motion model predicts them",
    "trigger",
    LOCATED,
    passes="Tracking: {value} matches (minimum {threshold}).",
    fails="Prediction poor: {value} matches where the motion model predicts them (minimum {threshold}).",
    topic="pose",
)
NEARBY_POINTS = Check(
    "nearby_points",
    "points matched near their last positions",
    "trigger",
    LOCATED,
    passes="Tracking: {value} matches near their last positions (minimum {threshold}); the prediction was poor.",
    fails="Few matches: {value} near their last positions (minimum {threshold}), so descriptors are compared.",
    topic="pose",
)
DESCRIBED_POINTS = Check(
    "described_points",
    "points matched with the help of descriptors",
    "requirement",
    LOCATED,
    passes="Tracking: {value} matches with the help of descriptors ({threshold} needed).",
    fails="Lost: {value} matches even with descriptors ({threshold} needed).",
    topic="pose",
)
DEPTH_POINTS = Check(
    "depth_points",
    "points with depth",
    "requirement",
    "New start?",
    passes="{value} points have a depth ({threshold} needed).",
    fails="No map yet: {value} points have a depth ({threshold} needed).",
    topic="map",
)
IMAGES_EXCHANGED = Check(
    "images_exchanged",
    "matches with negative disparity",
    "requirement",
    LOCATED,
    "<=",
    passes="Disparity: {value} matches are negative, {threshold} positive.",
    fails="Images swapped: the disparity of {value} matches is negative, of {threshold} positive, as if left and right "
    "were exchanged.",
)
LEVELLED = Check(
    "levelled",
    "row offset of the right image as given, of most points",
    "warning",
    LEVEL,
    "<=",
    "px",
    passes="Pair levelled: the right image is {value} px off its rows, and is corrected from now on (limit {threshold} "
    "px).",
    fails="Pair not level: the right image is {value} px off its rows, too far to correct (limits: {threshold} px in "
    "the centre, 2 degrees).",
    topic="pair",
)
ROWS_CHANGED = Check(
    "rows_changed",
    "change of the right image's row offset",
    "warning",
    LEVEL,
    "<=",
    "px",
    passes="The right image's row offset changed by {value} px (limit {threshold} px).",
    fails="Rows changed: the right image's row offset changed by {value} px (limit {threshold} px). The right camera "
    "was moved, or the two images are of different moments.",
)
MOMENTS = Check(
    "different_moments",
    "change of the right image's row offset from pair to pair",
    "warning",
    LEVEL,
    "<=",
    "px",
    passes="The right image's row offset changes by {value} px from pair to pair (limit {threshold} px).",
    fails="Different moments: the right image's row offset changes from pair to pair, here by {value} px (limit "
    "{threshold} px), as where left and right are not exposed at the same time.",
)
LOST_PAIRS = Check(
    "lost_pairs",
    "lost pairs in a row",
    "requirement",
    LOCATED,
    "<=",
    passes="{value} pairs in a row are lost (a new start after {threshold}).",
    fails="New start: {value} pairs in a row are lost (limit {threshold}).",
)
DISPLACEMENT = Check(
    "displacement",
    "median displacement since the last keyframe",
    "trigger",
    KEY_FRAME,
    unit="px",
    passes="New keyframe: features moved {value} px (limit {threshold} px).",
    fails="No keyframe: features moved {value} px since the last one (keyframe from {threshold} px).",
)
ADJUSTED_ERROR = Check(
    "adjusted_error",
    "median reprojection error after the optimisation",
    "warning",
    ADJUSTED,
    "<=",
    "px",
    passes="Median reprojection error {value} px (expected: up to {threshold} px).",
    fails="Optimisation doubtful: the median reprojection error is {value} px (expected: up to {threshold} px).",
)
OUTLIERS = Check(
    "outliers",
    "outliers of the optimisation",
    "finding",
    ADJUSTED,
    "<=",
    passes="Outliers: {value} of {threshold} observations dropped.",
)
BEND = Check(
    "disparity_bend",
    "disparity offset at 27 deg relative to the centre",
    "finding",
    CALIBRATED,
    ">",
    "px",
    passes="Disparity offset at 27 deg relative to the centre: {value} px, significant (2 sigma: {threshold} px).",
    fails="Disparity offset at 27 deg relative to the centre: {value} px, not significant (2 sigma: {threshold} px).",
)
OBSERVABLE = Check(
    "right_observable",
    "observable corrections of the calibration",
    "finding",
    CALIBRATED,
    passes="All {threshold} corrections of the calibration are observable.",
    fails="{value} of {threshold} corrections of the calibration are observable.",
)


def _correction(key: str, name: str, unit: str, what: str) -> Check:
    """Returns the check of one calibration correction; `what` names the quantity in its sentences."""
    shown = f" {unit}" if unit else ""
    passes, fails = (
        f"{what}: {{value}}{shown}, {word} (2 sigma: {{threshold}}{shown})."
        for word in ("significant", "not significant")
    )
    return Check(key, name, "finding", CALIBRATED, ">", unit, passes, fails)


CORRECTIONS = (
    _correction("both_radial", "radial distortion k1 of both", "", "Error of k1 in both lenses"),
    _correction("both_radial_growth", "radial distortion k2 of both", "", "Error of k2 in both lenses"),
    _correction("disparity_offset", "disparity offset", "px", "Disparity offset in the centre"),
    _correction("right_pitch", "pitch of the right camera", "deg", "Pitch of the right camera (upwards)"),
    _correction("right_yaw", "yaw of the right camera", "deg", "Yaw of the right camera (to the right)"),
    _correction("right_roll", "roll of the right camera", "deg", "Roll of the right camera (clockwise)"),
    _correction("right_focal", "error of the right focal length", "%", "Error of the right focal length"),
    _correction("right_radial", "right radial distortion k1", "", "Error of k1 in the right lens"),
    _correction("right_radial_growth", "right radial distortion k2", "", "Error of k2 in the right lens"),
    _correction("right_decentring_y", "right decentring p1", "", "Error of p1 in the right lens"),
    _correction("right_decentring_x", "right decentring p2", "", "Error of p2 in the right lens"),
    _correction(
        "right_decentring_y_growth", "growth of the right decentring p1", "", "Growth of the right p1 with r^2"
    ),
    _correction(
        "right_decentring_x_growth", "growth of the right decentring p2", "", "Growth of the right p2 with r^2"
    ),
    _correction("baseline_ahead", "baseline direction, forwards", "deg", "Direction of the baseline (forwards)"),
    _correction("shutter_lag", "time offset of the right camera", "ms", "Time offset of the right camera"),
    _correction("row_offset", "row offset", "px", "Row offset of the right image in the centre"),
    _correction("baseline_down", "baseline direction, downwards", "deg", "Direction of the baseline (downwards)"),
)
"""The checks of the corrections, in the order of right_camera.TERMS."""

CHECKS = by_key(
    GUIDED_POINTS,
    NEARBY_POINTS,
    DESCRIBED_POINTS,
    DEPTH_POINTS,
    IMAGES_EXCHANGED,
    LEVELLED,
    ROWS_CHANGED,
    MOMENTS,
    LOST_PAIRS,
    SECOND_MOTION,
    WIDER,
    LARGER,
    DISPLACEMENT,
    POINTS_LEFT,
    ADJUSTED_ERROR,
    COST,
    ITERATIONS,
    OUTLIERS,
    WINDOW,
    *CORRECTIONS,
    BEND,
    OBSERVABLE,
    NOISE,
    *LOOP_CHECKS,
)
