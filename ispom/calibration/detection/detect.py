"""One image: its target, or the reason why it is not used."""

from __future__ import annotations

from ispom.calibration.detection.chessboard import detect_chessboard
from ispom.calibration.detection.circles import detect_circles
from ispom.calibration.detection.detection import Detection
from ispom.calibration.detection.markers import detect_markers
from ispom.calibration.targets import Target
from ispom.types import Image, as_grey

LEAST_POINTS = 8
"""A pose and two more numbers: fewer say nothing about the camera."""
BLURRED_PX = 0.15
"""Images whose corners are this uncertain at the median are rejected,"""
VAGUE_PX = 1.0
"""and single corners beyond this."""


def detect(target: Target, image: Image) -> Detection:
    """The target's points in an image (H, W) or (H, W, 3) RGB. Deterministic."""
    grey = as_grey(image)
    if target.kind == "chessboard":
        found = detect_chessboard(target, grey)
    elif target.tags:
        found = detect_markers(target, grey)
    else:
        found = detect_circles(target, grey)
    return found if found.reason else checked(found)


def checked(found: Detection) -> Detection:
    """Without corners that are vague; the whole image rejected where it is blurred, or shows too little."""
    if len(found) >= LEAST_POINTS and sorted(found.sigma_px)[len(found) // 2] > BLURRED_PX:
        blurred = sorted(found.sigma_px)[len(found) // 2]
        return Detection(reason=f"blurred: corners uncertain by {blurred:.1f} px")
    found = found.only(found.sigma_px <= VAGUE_PX, "vague")
    if len(found) < LEAST_POINTS:
        return Detection(reason=f"only {len(found)} points of the target, {LEAST_POINTS} are needed")
    return found
