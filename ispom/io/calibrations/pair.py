"""Checks of the geometry and the unit of a stereo pair, and its rectification."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.cameras import require_opencv
from ispom.geometry import Pose
from ispom.types import Camera

MIN_BASELINE_M, MAX_BASELINE_M = 0.005, 2.0
"""Range of the baselines of nearly all stereo cameras, from endoscopes to cars."""
LIKELY_MILLIMETRES = 20.0
"""Baseline from which on the number is likely in millimetres; between MAX_BASELINE_M and this it is in another unit."""


def pair_fault(left_from_right: Pose) -> str:
    """Returns one clause that describes the error in the right camera's pose; empty where it is to the right of the
    left one."""
    x, y, z = left_from_right.translation.tolist()
    if not np.hypot(np.hypot(x, y), z) > 0:
        return "both cameras are at one place, without a baseline"
    if abs(x) <= abs(y):
        return f"the right camera is {abs(y):.4g} m {'below' if y > 0 else 'above'} the left one, not to its right"
    if x < 0:
        return f"the cameras are exchanged: the right one is {-x:.4g} m to the left of the left one"
    return ""


def unit_note(baseline_m: float) -> str:
    """Returns one sentence with the likely unit where a baseline's size shows that it is not in metres; else ""."""
    size = abs(baseline_m)
    if not size or MIN_BASELINE_M <= size <= MAX_BASELINE_M:
        return ""
    if size < MIN_BASELINE_M:
        return f"the baseline is {size:.4g} m, shorter than any stereo camera's: lengths are likely not in metres"
    if size >= LIKELY_MILLIMETRES:
        return f"the baseline is {size:.4g} m: it is likely in millimetres ({size / 1000:.4g} m), give metres"
    return (
        f"the baseline is {size:.4g} m: it is likely in squares of the board, in centimetres ({size / 100:.3g} m) "
        f"or in inches ({size * 0.0254:.3g} m), give metres"
    )


def rectified(left: Camera, right: Camera, right_from_left: Pose) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Returns rotations (3, 3) and projections (3, 4) of left and right by cv2.stereoRectify, or its fisheye
    version.

    Raises ValueError where only one of them is a fisheye, and where OpenCV finds none.
    """
    if left.lens != right.lens:
        raise ValueError("one lens is a fisheye and the other is not")
    k_left, k_right, size = left.matrix, right.matrix, (left.width, left.height)
    d_left, d_right = coefficients_of(left), coefficients_of(right)
    turn, shift = right_from_left.rotation, right_from_left.translation.reshape(3, 1)
    flags = cv2.CALIB_ZERO_DISPARITY
    stereo = (k_left, d_left, k_right, d_right, size, turn, shift)
    try:
        if left.lens == "fisheye":
            rectification = cv2.fisheye.stereoRectify(*stereo, flags, balance=0.0)[:4]
        else:
            rectification = cv2.stereoRectify(*stereo, flags=flags, alpha=0)[:4]
    except cv2.error:
        raise ValueError("OpenCV cannot rectify them") from None
    r_left, r_right, p_left, p_right = (np.asarray(matrix, float) for matrix in rectification)
    return r_left, r_right, p_left, p_right


def coefficients_of(camera: Camera) -> NDArray:
    """Returns the distortion in the form that OpenCV's functions take."""
    require_opencv(camera, "rectification")
    return np.array(camera.distortion or (0.0,) * (4 if camera.lens == "fisheye" else 0), float)
