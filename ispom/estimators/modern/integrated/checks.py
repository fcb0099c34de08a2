"""The checks of the integrated method."""

from __future__ import annotations

from ispom.types import Check, by_key

VIEWS = Check("views", "exposures to adjust together", "finding", relation="<=")
POINTS = Check("points", "points for an adjustment", "requirement", "Window adjusted?")
SPLINE_MISFIT = Check("spline_misfit", "misfit of the poses to the spline", "finding", relation="<=")
JOINT_COST = Check("joint_cost", "joint cost, after / before", "finding", relation="<=")
VIDEO_TURNED = Check("video_turned", "video camera turned", "finding", relation=">", unit="deg")
VIDEO_SHIFTED = Check("video_shifted", "video camera shifted", "finding", relation=">", unit="mm")
CLOCK_OFFSET = Check("clock_offset", "clock offset of the video", "finding", relation=">", unit="ms")

CHECKS = by_key(VIEWS, POINTS, SPLINE_MISFIT, JOINT_COST, VIDEO_TURNED, VIDEO_SHIFTED, CLOCK_OFFSET)
