"""The checks of the monocular method, and the stages of a step."""

from __future__ import annotations

from ispom.estimators.adjustment import ADJUSTED, BUNDLE_COST, COST, ITERATIONS, WINDOW
from ispom.estimators.key_frame_checks import KEY_FRAME, PARALLAX, POINTS_LEFT
from ispom.estimators.modern.loops.checks import LOOP_CHECKS
from ispom.estimators.modern.motions import LARGER, SECOND_MOTION, WIDER
from ispom.estimators.modern.noise import NOISE
from ispom.types import Check, by_key

LOCATED, FIRST_MAP = "Frame located?", "First map?"
UNIT, CALIBRATED = "Unit kept?", "Is the calibration right?"

STAGES = {
    "track": "Follows the tracks into the new image (KLT), from where the motion so far puts them.",
    "start": "No map yet: collects frames since the first until two of them give one.",
    "locate": "Finds the pose from the map's points, and compares each track with the image it was first seen in.",
    "key frame": "Adds the frame to the map with new points, adjusts the window, and drops what disagrees.",
    "other motion": "Follows on what ended as no still point, and tells where one other motion explains it.",
    "new points": "Looks for corners where tracks are missing, at key frames, and keeps what the next frame needs.",
    "loops": "Looks for earlier places, where that is wanted, and tells poses anew once one was found.",
}
"""By their names in Step.seconds, in order."""

POSE_POINTS = Check(
    "pose_points",
    "points that agree with the pose",
    "requirement",
    LOCATED,
    passes="Located: {value} points agree with one pose, {threshold} are needed.",
    fails="Not located: {value} points agree with one pose, {threshold} are needed.",
)
DESCRIBED_POINTS = Check(
    "described_points",
    "points seen again by descriptors",
    "finding",
    LOCATED,
    passes="Tracking lost its way; descriptors show {value} points again, {threshold} tell where to look for others.",
    fails="Tracking lost its way; descriptors show {value} points again, {threshold} would tell where to look.",
)
TURN_ONLY = Check(
    "turn_only",
    "motion besides a turn",
    "finding",
    "Turned on the spot?",
    "<",
    "deg",
    passes="The camera turned on the spot: besides the turn, points moved {value} degrees (less than {threshold}).",
    fails="More than a turn: besides it, points moved {value} degrees ({threshold} or more).",
)
VIEW_ANGLE = Check(
    "view_angle",
    "turned since the last key frame",
    "trigger",
    KEY_FRAME,
    unit="deg",
    passes="Key frame: turned {value} degrees, {threshold} are enough.",
    fails="No reason for a key frame: turned {value} of {threshold} degrees.",
)
INTERVAL = Check(
    "interval",
    "time since the last key frame",
    "trigger",
    KEY_FRAME,
    unit="s",
    passes="Key frame: {value} s since the last one, {threshold} are enough with some parallax.",
    fails="No reason for a key frame: {value} s since the last one; {threshold} are needed, and some parallax.",
)
OUTLIERS = Check(
    "outliers",
    "points dropped by the adjustment",
    "finding",
    ADJUSTED,
    "<=",
    passes="Of {threshold} points {value} disagree and are dropped.",
)
STEP_SCALE = Check(
    "step_scale",
    "scale drift of this step",
    "warning",
    UNIT,
    "<=",
    passes="The unit of this step differs from the map's by {value:.2%}, no more than noise ({threshold:.2%}).",
    fails="The unit of this step differs from the map's by {value:.2%}, more than noise ({threshold:.2%}).",
)
SCALE_DRIFT = Check(
    "scale_drift",
    "scale drift since the start, 1 sigma",
    "warning",
    UNIT,
    "<=",
    "%",
    passes="The unit has a spread of {value} % (1 sigma) against that of the start; beyond {threshold} % it is marked.",
    fails="The unit has a spread of {value} % (1 sigma) against that of the start, more than {threshold} %.",
)
FOCAL_LENGTH = Check(
    "focal_length",
    "correction of the focal length",
    "warning",
    CALIBRATED,
    "<=",
    "%",
    passes="The images correct the focal length by {value} %, as careful calibration may leave (up to {threshold} %).",
    fails="The images correct the focal length by {value} %, more than a careful calibration leaves ({threshold} %).",
)

START_POINTS = Check(
    "start_points",
    "share of the first frame's points left",
    "requirement",
    FIRST_MAP,
    passes="{value:.0%} of the first frame's points are left, {threshold:.0%} are needed.",
    fails="Too few of the first frame's points are left ({value:.0%}): a map is tried now, or this start is given up.",
)
START_PARALLAX = Check(
    "start_parallax",
    "parallax since the first frame",
    "trigger",
    FIRST_MAP,
    unit="deg",
    passes="A map is tried: moved {value} degrees since the first frame, {threshold} are enough.",
    fails="No map: moved {value} of {threshold} degrees since the first frame.",
)
TRAVEL = Check(
    "travel",
    "motion besides a turn and a zoom",
    "requirement",
    FIRST_MAP,
    unit="deg",
    passes="The camera travelled: no turn and zoom explains {value} degrees of the motion, {threshold} are needed.",
    fails="No map: a turn and a zoom explain all but {value} degrees of the motion, {threshold} are needed.",
)
PLANE_SHARE = Check(
    "plane_share",
    "share of points that a plane explains",
    "finding",
    FIRST_MAP,
    passes="Mostly a plane: a homography explains {value:.0%} as many points as the essential matrix.",
    fails="No single plane: a homography explains {value:.0%} as many points as the essential matrix.",
)
MAPS = Check(
    "maps",
    "hypotheses that give a map",
    "requirement",
    FIRST_MAP,
    passes="{value} of the two-view motions give a map.",
    fails="No map: none of the two-view motions, of essential matrix and homography, gives one.",
)
MODEL = Check(
    "homography_cost",
    "cost of the homography's map / the essential matrix's",
    "finding",
    FIRST_MAP,
    "<",
    passes="Model: homography; its map has {value} times the cost of the essential matrix's.",
    fails="Model: essential matrix; the homography's map has {value} times its cost.",
)
AMBIGUITY = Check(
    "ambiguity",
    "cost of the second best pose / best",
    "requirement",
    FIRST_MAP,
    passes="The second best motion costs {value} times as much as the best; {threshold} make it clear.",
    fails="Ambiguous: the second best motion costs {value} times as much as the best, {threshold} are needed.",
)
EXPLAINED_SHARE = Check(
    "explained_share",
    "share of points that the best pose explains",
    "requirement",
    FIRST_MAP,
    passes="The best motion explains {value:.0%} of the points, {threshold:.0%} are needed.",
    fails="The best motion explains {value:.0%} of the points only, {threshold:.0%} are needed.",
)
UNIT_POINTS = Check(
    "unit_points",
    "points that carry the unit over",
    "requirement",
    UNIT,
    passes="{value} points of the map before the loss carry its unit over, {threshold} are needed.",
    fails="{value} points of the map before the loss are seen again; to carry its unit over, {threshold} are needed.",
)
UNIT_FACTOR = Check(
    "unit_factor",
    "unit before the loss / that of the new map",
    "finding",
    UNIT,
    ">",
    passes="The new map was scaled by {value} to the unit before the loss.",
)
UNIT_SPREAD = Check(
    "unit_spread",
    "spread of the unit carried over, 1 sigma",
    "warning",
    UNIT,
    "<=",
    "%",
    passes="The unit before the loss is known to {value} % (1 sigma); beyond {threshold} % it is marked.",
    fails="The unit before the loss is known to {value} % only (1 sigma), beyond {threshold} %.",
)

CHECKS = by_key(
    POSE_POINTS,
    DESCRIBED_POINTS,
    TURN_ONLY,
    PARALLAX,
    POINTS_LEFT,
    VIEW_ANGLE,
    INTERVAL,
    BUNDLE_COST,
    COST,
    ITERATIONS,
    OUTLIERS,
    WINDOW,
    STEP_SCALE,
    SCALE_DRIFT,
    FOCAL_LENGTH,
    START_POINTS,
    START_PARALLAX,
    TRAVEL,
    PLANE_SHARE,
    MAPS,
    MODEL,
    AMBIGUITY,
    EXPLAINED_SHARE,
    SECOND_MOTION,
    WIDER,
    LARGER,
    UNIT_POINTS,
    UNIT_FACTOR,
    UNIT_SPREAD,
    NOISE,
    *LOOP_CHECKS,
)
