"""The checks of the integrated method, and the stages of a step."""

from __future__ import annotations

from ispom.estimators.adjustment import ADJUSTED, COST, ITERATIONS
from ispom.types import Check, by_key

CALIBRATED, ALIGNED = "Is the calibration right?", "How well does it align with stereo?"

STAGES = {
    "place": "Estimates the pose of the frame from known points.",
    "adjust": "After a stereo pair: fits one spline to all observations of both cameras in the window.",
}
"""Descriptions of the stages of a step, by their keys in Step.seconds, in order."""
VIEWS = Check(
    "views",
    "frames optimised together",
    "finding",
    relation="<=",
    passes="{value} frames are optimised together (maximum {threshold}).",
    fails="{value} frames are too many to optimise together (maximum {threshold}).",
)
RIGHT_FITS = Check(
    "right_fits",
    "share of the pair's points with a consistent right match",
    "requirement",
    "Pair used?",
    relation=">=",
    passes="Pair used: {value:.0%} of its points have a consistent right match ({threshold:.0%} needed).",
    fails="Pair skipped: {value:.0%} of its points have a consistent right match ({threshold:.0%} needed).",
)
POINTS = Check(
    "points",
    "points for the optimisation",
    "requirement",
    "Window optimised?",
    passes="{value} points have enough observations for the optimisation.",
    fails="Not optimised: too few points have enough observations.",
)
SPLINE_MISFIT = Check(
    "spline_misfit",
    "misfit of the spline to the poses",
    "warning",
    ADJUSTED,
    "<=",
    passes="Spline fits the motion: chi-squared misfit {value} (limit {threshold}).",
    fails="Motion too fast: even the densest knots leave a chi-squared misfit of {value} (limit {threshold}).",
)
JOINT_COST = Check(
    "joint_cost",
    "joint cost, after / before",
    "warning",
    ADJUSTED,
    "<=",
    passes="The optimisation reduced the cost to {value:.1%}.",
    fails="Optimisation doubtful: it did not reduce the cost ({value:.1%} of it is left).",
)
OUTLIERS = Check(
    "outliers",
    "outlier observations",
    "finding",
    ADJUSTED,
    "<=",
    passes="Outliers: {value} of {threshold} observations are beyond 8 sigma.",
)
WINDOW = Check(
    "window",
    "pairs in the window",
    "finding",
    ADJUSTED,
    "<=",
    passes="The window holds {value} pairs (maximum {threshold}).",
    fails="The window is full: the oldest of its {value} pairs left it ({threshold} are kept).",
)
ALIGN_SCALE = Check(
    "align_scale",
    "length of the window by stereo / by the spline",
    "finding",
    ALIGNED,
    ">",
    passes="Scale: the window is {value} times as long by stereo as by the spline.",
)
ALIGN_TURN = Check(
    "align_turn",
    "rotation of the window onto stereo's world",
    "finding",
    ALIGNED,
    ">",
    "deg",
    passes="Rotation: {value} deg align the window with stereo's pose at the last pair.",
    fails="Rotation: none is needed to align the window with stereo's pose at the last pair.",
)
ALIGN_RESIDUAL = Check(
    "align_residual",
    "distance of the window's pairs from stereo's, rms",
    "finding",
    ALIGNED,
    ">",
    "mm",
    passes="Residual: the window's pairs then differ from stereo's by {value} mm (root mean square).",
    fails="Residual: the window's pairs coincide with stereo's.",
)
VIDEO_TURNED = Check(
    "video_turned",
    "rotation of the video camera",
    "finding",
    CALIBRATED,
    ">",
    "deg",
    passes="Rotation of the video camera on the rig: {value} deg, significant (2 sigma: {threshold} deg).",
    fails="Rotation of the video camera on the rig: {value} deg, not significant (2 sigma: {threshold} deg).",
)
VIDEO_SHIFTED = Check(
    "video_shifted",
    "displacement of the video camera",
    "finding",
    CALIBRATED,
    ">",
    "mm",
    passes="Displacement of the video camera on the rig: {value} mm, significant (2 sigma: {threshold} mm).",
    fails="Displacement of the video camera on the rig: {value} mm, not significant (2 sigma: {threshold} mm).",
)
CLOCK_OFFSET = Check(
    "clock_offset",
    "time offset of the video",
    "finding",
    CALIBRATED,
    ">",
    "ms",
    passes="Time offset of the video: {value} ms, significant (2 sigma: {threshold} ms).",
    fails="Time offset of the video: {value} ms, not significant (2 sigma: {threshold} ms).",
)

CHECKS = by_key(
    RIGHT_FITS,
    VIEWS,
    POINTS,
    SPLINE_MISFIT,
    JOINT_COST,
    COST,
    ITERATIONS,
    OUTLIERS,
    WINDOW,
    ALIGN_SCALE,
    ALIGN_TURN,
    ALIGN_RESIDUAL,
    VIDEO_TURNED,
    VIDEO_SHIFTED,
    CLOCK_OFFSET,
)
