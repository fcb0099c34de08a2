"""The checks of the monocular method."""

from __future__ import annotations

from ispom.types import Check, by_key

LOCATED, KEY_FRAME, FIRST_MAP = "Frame located?", "New key frame?", "First map?"

POSE_POINTS = Check("pose_points", "points that agree with the pose", "requirement", LOCATED)
TURN_ONLY = Check("turn_only", "motion besides a turn", "finding", "Turned on the spot?", "<", "deg")
PARALLAX = Check("parallax", "parallax since the last key frame", "trigger", KEY_FRAME, unit="deg")
POINTS_LEFT = Check("points_left", "share of the last key frame's points left", "trigger", KEY_FRAME, "<")
VIEW_ANGLE = Check("view_angle", "turned since the last key frame", "trigger", KEY_FRAME, unit="deg")
INTERVAL = Check("interval", "time since the last key frame", "trigger", KEY_FRAME, unit="s")
BUNDLE_COST = Check("bundle_cost", "bundle cost, after / before", "finding", relation="<")
STEP_SCALE = Check("step_scale", "scale drift of this step", "finding", relation="<=")
SCALE_DRIFT = Check("scale_drift", "scale drift since the start, 1 sigma", "finding", relation="<=", unit="%")
FOCAL_LENGTH = Check("focal_length", "correction of the focal length", "finding", relation="<=", unit="%")

START_POINTS = Check("start_points", "share of the first frame's points left", "requirement", FIRST_MAP)
START_PARALLAX = Check("start_parallax", "parallax since the first frame", "trigger", FIRST_MAP, unit="deg")
PLANE_SHARE = Check("plane_share", "share of points that a plane explains", "finding", FIRST_MAP)
MAPS = Check("maps", "hypotheses that give a map", "requirement", FIRST_MAP)
AMBIGUITY = Check("ambiguity", "cost of the second best pose / best", "requirement", FIRST_MAP)
EXPLAINED_SHARE = Check("explained_share", "share of points that the best pose explains", "requirement", FIRST_MAP)
UNIT_POINTS = Check("unit_points", "points that carry the unit over", "requirement", "Unit kept?")

CHECKS = by_key(
    POSE_POINTS,
    TURN_ONLY,
    PARALLAX,
    POINTS_LEFT,
    VIEW_ANGLE,
    INTERVAL,
    BUNDLE_COST,
    STEP_SCALE,
    SCALE_DRIFT,
    FOCAL_LENGTH,
    START_POINTS,
    START_PARALLAX,
    PLANE_SHARE,
    MAPS,
    AMBIGUITY,
    EXPLAINED_SHARE,
    UNIT_POINTS,
)
