"""Rectification of raw stereo images: one camera matrix without distortion, and aligned rows."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Pose
from ispom.io.calibrations.pair import coefficients_of, rectified
from ispom.types import Camera, Image, Rig

Maps = tuple[NDArray, NDArray]
"""Arguments of cv2.remap: x and y in the raw image of each pixel of the rectified one."""


@dataclass(frozen=True, eq=False)
class Rectification:
    """The rectification of a pair of cameras (cv2.stereoRectify, after Fusiello et al.)."""

    camera: Camera
    """The camera of both rectified images."""
    baseline_m: float
    """Negative where the second camera is to the left of the first."""
    left_from_rectified: Pose
    left_maps: Maps
    right_maps: Maps

    @staticmethod
    def of(left: Camera, right: Camera, right_from_left: Pose) -> Rectification:
        """Returns the rectification in which all pixels of the rectified images are inside the raw ones. Raises
        ValueError where one camera is above the other."""
        size = (left.width, left.height)
        turn_left, turn_right, p_left, p_right = rectified(left, right, right_from_left)
        if p_right[0, 3] == 0:
            raise ValueError("the cameras are not beside each other")
        fx, fy, cx, cy = p_left[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
        return Rectification(
            Camera(*size, fx, fy, cx, cy, line_delay_s=_line_delay_s(left, right, fy)),
            float(-p_right[0, 3] / p_right[0, 0]),
            Pose(np.asarray(turn_left, float).T),
            undistortion(left, turn_left, p_left, size),
            undistortion(right, turn_right, p_right, size),
        )

    def placed(self, rig: Rig) -> Rig:
        """Returns the rig of this pair with rectified cameras."""
        rig_from_left = rig.rig_from_left @ self.left_from_rectified
        left_from_right = Pose(translation=np.array([self.baseline_m, 0.0, 0.0]))
        return rig.changed(
            left=self.camera,
            right=self.camera,
            rig_from_left=rig_from_left,
            rig_from_right=rig_from_left @ left_from_right,
        )


def _line_delay_s(left: Camera, right: Camera, fy: float) -> float:
    """Returns the delay from row to row of the rectified images, in their middle [s]."""
    return 0.5 * (left.line_delay_s * left.fy + right.line_delay_s * right.fy) / fy


def undistortion(camera: Camera, turn: NDArray, projection: NDArray, size: tuple[int, int]) -> Maps:
    """Returns the maps from an image of `size` (width, height) to the camera's own image.

    The image has the projection matrix `projection` (3, 3) or (3, 4), in axes that are `turn` (3, 3) times the
    camera's.
    """
    # Not in fixed point: positions rounded to 1/32 px have common errors, and so have tracks.
    maps = cv2.fisheye.initUndistortRectifyMap if camera.lens == "fisheye" else cv2.initUndistortRectifyMap
    first, second = maps(camera.matrix, coefficients_of(camera), turn, projection[:, :3], size, cv2.CV_32FC1)
    return first, second


def remapped(image: Image, maps: Maps) -> Image:
    """Returns the image remapped by the maps, read-only.

    Interpolates linearly in the image at twice the resolution. In the original one, linear interpolation shifts fine
    texture, and all tracks on it, by up to 0.012 px towards the nearest pixel; cv2.remap's cubic interpolation rounds
    positions to 1/32 px.
    """
    fine = cv2.resize(image.astype(np.float32), None, fx=2, fy=2, interpolation=cv2.INTER_LANCZOS4)
    resampled = cv2.remap(fine, 2 * maps[0] + 0.5, 2 * maps[1] + 0.5, cv2.INTER_LINEAR)
    resampled = np.rint(np.clip(resampled, 0, 255)).astype(np.uint8)
    resampled.setflags(write=False)
    return resampled
