"""The checks of the monocular method, and the stages of a step."""

from __future__ import annotations

from ispom.estimators.adjustment import ADJUSTED, BUNDLE_COST, COST, ITERATIONS, WINDOW
from ispom.estimators.key_frame_checks import KEY_FRAME, PARALLAX, POINTS_LEFT
from ispom.estimators.modern.loops.checks import LOOP_CHECKS
from ispom.estimators.modern.noise import NOISE
from ispom.estimators.modern.second_motion import LARGER, SECOND_MOTION, WIDER
from ispom.types import Check, by_key

LOCATED, FIRST_MAP = "Frame localised?", "First map?"
JOIN = "Joined with an earlier segment?"
UNIT, CALIBRATED = "Is the scale reliable?", "Is the calibration right?"

STAGES = {
    "track": "Tracks features into the new image (KLT), starting from the positions that the motion model predicts.",
    "start": "No map yet: collects frames until two of them give a first map.",
    "locate": "Estimates the pose from the map's points, and checks each track against the patch it was first seen as.",
    "key frame": "Adds a keyframe with new points, optimises the window, and drops outliers.",
    "other motion": "Moving objects: checks whether rejected tracks move together as one rigid object.",
    "lost frames": "Tries frames again that were lost, among the keyframes that were added since.",
    "new points": "Detects new corners at keyframes, where tracks are missing.",
    "loops": "Loop closure: looks for earlier keyframes that show the same scene, and corrects the poses.",
    "join": "Joins segments: looks for what earlier segments saw, and measures the common scale from it.",
}
"""Descriptions of the stages of a step, by their keys in Step.seconds, in order."""

POSE_POINTS = Check(
    "pose_points",
    "inliers of the pose",
    "requirement",
    LOCATED,
    passes="Tracking: {value} inliers (minimum {threshold}).",
    fails="Lost: {value} inliers of the best pose ({threshold} needed).",
    topic="pose",
)
LASTING_POINTS = Check(
    "lasting_points",
    "share of points that agree with the map for long",
    "warning",
    LOCATED,
    passes="Points agree for long: {value:.0%} of the map's points do so for three keyframes or ten frames (at least "
    "{threshold:.0%} expected).",
    fails="Few points agree for long: only {value:.0%} of the map's points do so for three keyframes or ten frames "
    "({threshold:.0%} expected), so the map may be wrong, or the scene may move.",
    topic="map",
)
DESCRIBED_POINTS = Check(
    "described_points",
    "points matched by descriptors",
    "finding",
    LOCATED,
    passes="Relocalisation: descriptors match {value} points ({threshold} needed), which predict the others.",
    fails="Relocalisation failed: descriptors match {value} points ({threshold} needed).",
)
TURN_ONLY = Check(
    "turn_only",
    "motion besides the rotation",
    "finding",
    "Did the camera only rotate?",
    "<",
    "deg",
    passes="Rotation only: besides the rotation, points moved {value} deg (below {threshold} deg).",
    fails="Not only a rotation: besides it, points moved {value} deg (rotation only below {threshold} deg).",
)
VIEW_ANGLE = Check(
    "view_angle",
    "rotation since the last keyframe",
    "trigger",
    KEY_FRAME,
    unit="deg",
    passes="New keyframe: rotated {value} deg (limit {threshold} deg).",
    fails="No keyframe: rotated {value} deg since the last one (keyframe from {threshold} deg).",
)
INTERVAL = Check(
    "interval",
    "time since the last keyframe",
    "trigger",
    KEY_FRAME,
    unit="s",
    passes="New keyframe: {value} s since the last one, with some parallax (limit {threshold} s).",
    fails="No keyframe: {value} s since the last one (keyframe from {threshold} s and with some parallax).",
)
OUTLIERS = Check(
    "outliers",
    "outliers of the bundle adjustment",
    "finding",
    ADJUSTED,
    "<=",
    passes="Outliers: {value} of {threshold} points dropped.",
)
STEP_SCALE = Check(
    "step_scale",
    "scale drift of this step",
    "warning",
    UNIT,
    "<=",
    passes="Scale of this step: {value:.2%} from the map's (noise explains up to {threshold:.2%}).",
    fails="Scale drifts: the scale of this step differs from the map's by {value:.2%} (noise explains up to "
    "{threshold:.2%}).",
    topic="scale",
)
SCALE_DRIFT = Check(
    "scale_drift",
    "scale drift since the start, 1 sigma",
    "warning",
    UNIT,
    "<=",
    "%",
    passes="Scale since the start: standard deviation {value} % (limit {threshold} %).",
    fails="Scale unreliable: its standard deviation since the start is {value} % (limit {threshold} %).",
    topic="scale",
)
FOCAL_LENGTH = Check(
    "focal_length",
    "correction of the focal length",
    "warning",
    CALIBRATED,
    "<=",
    "%",
    passes="Focal length: the images correct it by {value} % (expected: up to {threshold} %).",
    fails="Calibration doubtful: the images correct the focal length by {value} % (limit {threshold} %).",
)

START_POINTS = Check(
    "start_points",
    "share of the first frame's points still tracked",
    "requirement",
    FIRST_MAP,
    passes="{value:.0%} of the first frame's points are still tracked ({threshold:.0%} needed).",
    fails="No map yet: {value:.0%} of the first frame's points are still tracked ({threshold:.0%} needed).",
    topic="map",
)
START_PARALLAX = Check(
    "start_parallax",
    "parallax since the first frame",
    "trigger",
    FIRST_MAP,
    unit="deg",
    passes="Parallax since the first frame: {value} deg ({threshold} deg needed for a map).",
    fails="No map yet: parallax {value} deg since the first frame ({threshold} deg needed).",
    topic="map",
)
TRAVEL = Check(
    "travel",
    "motion besides rotation and zoom",
    "requirement",
    FIRST_MAP,
    unit="deg",
    passes="Translation: rotation and zoom leave {value} deg of the motion unexplained ({threshold} deg needed).",
    fails="No map yet: rotation and zoom explain all but {value} deg of the motion ({threshold} deg needed).",
    topic="map",
)
PLANE_SHARE = Check(
    "plane_share",
    "share of points that a plane explains",
    "finding",
    FIRST_MAP,
    passes="Mostly a plane: a homography has {value:.0%} as many inliers as the essential matrix.",
    fails="Not a plane: a homography has {value:.0%} as many inliers as the essential matrix.",
)
MAPS = Check(
    "maps",
    "hypotheses that give a map",
    "requirement",
    FIRST_MAP,
    passes="{value} of the two-view hypotheses give a map.",
    fails="No map yet: no two-view hypothesis, of essential matrix or homography, gives a map.",
    topic="map",
)
MODEL = Check(
    "homography_cost",
    "cost of the homography's map / the essential matrix's",
    "finding",
    FIRST_MAP,
    "<",
    passes="Model: homography, whose map has {value} times the cost of the essential matrix's.",
    fails="Model: essential matrix; the homography's map has {value} times its cost.",
)
AMBIGUITY = Check(
    "ambiguity",
    "cost of the second best pose / best",
    "requirement",
    FIRST_MAP,
    passes="The second-best hypothesis costs {value} times as much as the best (at least {threshold} needed).",
    fails="No map yet: the second-best hypothesis costs only {value} times as much as the best (at least {threshold} "
    "needed).",
    topic="map",
)
EXPLAINED_SHARE = Check(
    "explained_share",
    "share of points that the best pose explains",
    "requirement",
    FIRST_MAP,
    passes="The best hypothesis explains {value:.0%} of the points ({threshold:.0%} needed).",
    fails="No map yet: the best hypothesis explains {value:.0%} of the points ({threshold:.0%} needed).",
    topic="map",
)
SCALE_KNOWN = Check(
    "scale_known",
    "scale uncertainty grown over the window",
    "requirement",
    UNIT,
    "<=",
    "%",
    passes="The scale's uncertainty grew by {value} % over the window (limit {threshold} %).",
    fails="The scale is lost: its uncertainty grew by {value} % over the window (limit {threshold} %).",
    topic="scale",
)
UNIT_POINTS = Check(
    "unit_points",
    "points that transfer the scale",
    "requirement",
    UNIT,
    passes="{value} points of the map before the loss transfer its scale ({threshold} needed).",
    fails="Scale not transferred: {value} points of the map before the loss are in the new one ({threshold} needed).",
    topic="scale",
)
UNIT_FACTOR = Check(
    "unit_factor",
    "scale before the loss / of the new map",
    "finding",
    UNIT,
    ">",
    passes="The new map was scaled by {value} to match the map before the loss.",
)
UNIT_SPREAD = Check(
    "unit_spread",
    "standard deviation of the transferred scale",
    "requirement",
    UNIT,
    "<=",
    "%",
    passes="Scale across the loss: standard deviation {value} % (limit {threshold} %).",
    fails="Scale not transferred: across the loss its standard deviation is {value} % (limit {threshold} %).",
    topic="scale",
)
JOIN_POINTS = Check(
    "join_points",
    "points in this segment and in an earlier one",
    "finding",
    JOIN,
    passes="{value} points have positions in this segment and in an earlier one ({threshold} needed).",
    fails="Only {value} points have positions in this segment and in an earlier one ({threshold} needed).",
)
JOIN_SCALE = Check(
    "join_scale",
    "standard deviation of the scale between the segments",
    "finding",
    JOIN,
    "<=",
    "%",
    passes="Scale between both segments: standard deviation {value} % (limit {threshold} %).",
    fails="Not joined: the scale between both segments has a standard deviation of {value} % (limit {threshold} %).",
)
JOIN_VIEWS = Check(
    "join_views",
    "keyframes that agree on the join",
    "trigger",
    JOIN,
    passes="Segments joined: {value} keyframes agree on the similarity of their worlds ({threshold} needed).",
    fails="Segments not joined yet: {value} keyframes agree on the similarity of their worlds ({threshold} needed).",
    topic="loop",
)

CHECKS = by_key(
    POSE_POINTS,
    LASTING_POINTS,
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
    SCALE_KNOWN,
    UNIT_POINTS,
    UNIT_FACTOR,
    UNIT_SPREAD,
    JOIN_POINTS,
    JOIN_SCALE,
    JOIN_VIEWS,
    NOISE,
    *LOOP_CHECKS,
)
