"""The checks of the integrated method, and the stages of a step."""

from __future__ import annotations

from ispom.estimators.adjustment import ADJUSTED, COST, ITERATIONS
from ispom.types import Check, by_key

CALIBRATED, ALIGNED = "Is the calibration right?", "How does it lie on the stereo path?"

STAGES = {
    "place": "Places the exposure by the points that are known by now.",
    "adjust": "After a pair: one spline through all that both cameras saw in the window, each at its own time.",
}
"""By their names in Step.seconds, in order."""

VIEWS = Check(
    "views",
    "exposures to adjust together",
    "finding",
    relation="<=",
    passes="{value} exposures are adjusted together, of at most {threshold}.",
    fails="{value} exposures are too many to adjust together ({threshold}).",
)
RIGHT_FITS = Check(
    "right_fits",
    "share of a pair's points whose right match fits",
    "requirement",
    "Pair taken?",
    relation=">=",
    passes="{value:.0%} of the points have a match in the right image that fits: the pair measures depth.",
    fails="Passed over: {value:.0%} of the points have a right match that fits, {threshold:.0%} are enough.",
)
POINTS = Check(
    "points",
    "points for an adjustment",
    "requirement",
    "Window adjusted?",
    passes="{value} points are seen often enough for an adjustment.",
    fails="Not adjusted: too few points are seen often enough.",
)
SPLINE_MISFIT = Check(
    "spline_misfit",
    "misfit of the poses to the spline",
    "warning",
    ADJUSTED,
    "<=",
    passes="A spline with these knots follows the motion: misfit {value} (in variances), {threshold} allowed.",
    fails="Even the densest knots leave a misfit of {value} (in variances); {threshold} are allowed.",
)
JOINT_COST = Check(
    "joint_cost",
    "joint cost, after / before",
    "warning",
    ADJUSTED,
    "<=",
    passes="The adjustment left {value:.1%} of the cost.",
    fails="The adjustment did not lower the cost: {value:.1%} of that before.",
)
OUTLIERS = Check(
    "outliers",
    "observations that hardly count",
    "finding",
    ADJUSTED,
    "<=",
    passes="Of {threshold} observations {value} are more than 8 sigma off, and hardly count.",
)
WINDOW = Check(
    "window",
    "pairs in the window",
    "finding",
    ADJUSTED,
    "<=",
    passes="The window holds {value} of at most {threshold} pairs: nothing leaves it.",
    fails="The window had {value} pairs, of which it keeps {threshold}.",
)
ALIGN_SCALE = Check(
    "align_scale",
    "length of the window by stereo / by the spline",
    "finding",
    ALIGNED,
    ">",
    passes="Scale: stereo finds the window {value} times as long as the spline does.",
)
ALIGN_TURN = Check(
    "align_turn",
    "window's world turned onto stereo's by",
    "finding",
    ALIGNED,
    ">",
    "deg",
    passes="Rotation: the window's world is turned by {value} degrees to meet stereo's pose at the last pair.",
    fails="Rotation: none is needed to meet stereo's pose at the last pair.",
)
ALIGN_RESIDUAL = Check(
    "align_residual",
    "distance of the window's pairs from stereo's, rms",
    "finding",
    ALIGNED,
    ">",
    "mm",
    passes="Residual: the window's pairs then lie {value} mm from stereo's poses (root mean square).",
    fails="Residual: the window's pairs lie on stereo's poses.",
)
VIDEO_TURNED = Check(
    "video_turned",
    "video camera turned",
    "finding",
    CALIBRATED,
    ">",
    "deg",
    passes="The video camera is turned by {value} degrees on the rig: significant, as 2 sigma are {threshold}.",
    fails="The video camera is turned by {value} degrees on the rig: not significant, as 2 sigma are {threshold}.",
)
VIDEO_SHIFTED = Check(
    "video_shifted",
    "video camera shifted",
    "finding",
    CALIBRATED,
    ">",
    "mm",
    passes="The video camera sits {value} mm off: significant, as 2 sigma are {threshold}.",
    fails="The video camera sits {value} mm off: not significant, as 2 sigma are {threshold}.",
)
CLOCK_OFFSET = Check(
    "clock_offset",
    "clock offset of the video",
    "finding",
    CALIBRATED,
    ">",
    "ms",
    passes="The video's clock is off by {value} ms: significant, as 2 sigma are {threshold}.",
    fails="The video's clock is off by {value} ms: not significant, as 2 sigma are {threshold}.",
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
