"""How a pair of cameras is rectified, as OpenCV does it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.cameras import require_opencv
from ispom.geometry import Pose
from ispom.types import Camera


def rectified(left: Camera, right: Camera, right_from_left: Pose) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Rotations (3, 3) and projections (3, 4) of left and right by cv2.stereoRectify, or its twin for fisheye lenses.

    ValueError where only one of them is a fisheye, and where OpenCV finds none.
    """
    if left.lens != right.lens:
        raise ValueError("one lens is a fisheye and the other is not")
    k_left, k_right, size = left.matrix, right.matrix, (left.width, left.height)
    d_left, d_right = coefficients_of(left), coefficients_of(right)
    turn, shift = right_from_left.rotation, right_from_left.translation.reshape(3, 1)
    flags = cv2.CALIB_ZERO_DISPARITY
    given = (k_left, d_left, k_right, d_right, size, turn, shift)
    try:
        if left.lens == "fisheye":
            found = cv2.fisheye.stereoRectify(*given, flags, balance=0.0)[:4]
        else:
            found = cv2.stereoRectify(*given, flags=flags, alpha=0)[:4]
    except cv2.error:
        raise ValueError("OpenCV cannot rectify them") from None
    r_left, r_right, p_left, p_right = (np.asarray(matrix, float) for matrix in found)
    return r_left, r_right, p_left, p_right


def coefficients_of(camera: Camera) -> NDArray:
    """Its distortion as OpenCV takes it."""
    require_opencv(camera, "rectification")
    return np.array(camera.distortion or (0.0,) * (4 if camera.lens == "fisheye" else 0), float)
