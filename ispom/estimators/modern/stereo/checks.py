"""The checks of the stereo method, and the stages of a step."""

from __future__ import annotations

from ispom.estimators.adjustment import ADJUSTED, COST, ITERATIONS, WINDOW
from ispom.estimators.key_frame_checks import KEY_FRAME, POINTS_LEFT
from ispom.estimators.modern.loops.checks import LOOP_CHECKS
from ispom.estimators.modern.motions import LARGER, SECOND_MOTION, WIDER
from ispom.estimators.modern.noise import NOISE
from ispom.types import Check, by_key

LOCATED, CALIBRATED = "Pair located?", "Is the calibration right?"

STAGES = {
    "track": "Follows the points into the left image, then into the right one, and locates the pair by both.",
    "other motion": "Tells where one other motion explains points that ended as not standing still.",
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
IMAGES_EXCHANGED = Check(
    "images_exchanged",
    "points matched where only those behind the cameras are",
    "requirement",
    LOCATED,
    "<=",
    passes="{value} points lie farther right in the right image, as none before the cameras does, {threshold} farther "
    "left.",
    fails="Left and right seem to be exchanged: {value} points lie farther right in the right image, as none before "
    "the cameras does, {threshold} farther left.",
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
BEND = Check(
    "disparity_bend",
    "disparity offset at 27 degrees against the middle",
    "finding",
    CALIBRATED,
    ">",
    "px",
    passes="27 degrees to the sides it is off by {value} px more: significant, as 2 sigma are {threshold}.",
    fails="27 degrees to the sides it is off by {value} px more: not significant, as 2 sigma are {threshold}.",
)
OBSERVABLE = Check(
    "right_observable",
    "corrections of the pair that the data show",
    "finding",
    CALIBRATED,
    passes="The data show all {threshold} corrections of the pair.",
    fails="Of {threshold} corrections of the pair the data show {value}; the others stay about as uncertain as "
    "they were.",
)


def _correction(key: str, name: str, unit: str, sentence: str) -> Check:
    """Of one term; `sentence` says what is wrong, with {value}."""
    passes, fails = (
        f"{sentence}: {word}, as 2 sigma are {{threshold}}." for word in ("significant", "not significant")
    )
    return Check(key, name, "finding", CALIBRATED, ">", unit, passes, fails)


CORRECTIONS = (
    _correction("both_radial", "radial distortion k1 of both", "", "Both lenses have k1 off by {value}"),
    _correction("both_radial_growth", "radial distortion k2 of both", "", "Both lenses have k2 off by {value}"),
    _correction("disparity_offset", "disparity offset", "px", "The right image is off by {value} px in the middle"),
    _correction("right_pitch", "right camera turned about x by", "deg", "The right camera is turned up by {value} deg"),
    _correction(
        "right_yaw", "right camera turned about y by", "deg", "The right camera is turned right by {value} deg"
    ),
    _correction(
        "right_roll", "right camera turned about z by", "deg", "The right camera is turned clockwise by {value} deg"
    ),
    _correction("right_focal", "right focal length longer by", "%", "The right focal length is {value} % longer"),
    _correction("right_radial", "right radial distortion k1", "", "The right lens has k1 off by {value}"),
    _correction("right_radial_growth", "right radial distortion k2", "", "The right lens has k2 off by {value}"),
    _correction("right_decentring_y", "right decentring p1", "", "The right lens has p1 off by {value}"),
    _correction("right_decentring_x", "right decentring p2", "", "The right lens has p2 off by {value}"),
    _correction(
        "right_decentring_y_growth", "growth of the right decentring p1", "", "The right p1 grows by {value} with r^2"
    ),
    _correction(
        "right_decentring_x_growth", "growth of the right decentring p2", "", "The right p2 grows by {value} with r^2"
    ),
    _correction("baseline_ahead", "right camera ahead by", "deg", "The right camera sits {value} deg ahead"),
    _correction("shutter_lag", "right shutter late by", "ms", "The right shutter is {value} ms late"),
    _correction("row_offset", "row offset", "px", "The right image is {value} px lower in the middle"),
    _correction("baseline_down", "right camera lower by", "deg", "The right camera sits {value} deg lower"),
)
"""Of right_camera.TERMS, in that order."""

CHECKS = by_key(
    GUIDED_POINTS,
    NEARBY_POINTS,
    DESCRIBED_POINTS,
    DEPTH_POINTS,
    IMAGES_EXCHANGED,
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
