"""Triangulates points from two views (section 6.1, step 3) and from disparities (section 6.2)."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.geometry import Array, Pose
from ispom.types import Camera


def triangulate(second_from_first: Pose, x1: Array, x2: Array) -> Array:
    """Triangulates points (N, 3) in the first camera from normalised coordinates (N, 2) in two views.

    Linear method (Hartley 12.2). Points at infinity come out huge or behind the camera: check `parallax_rad` and
    depths.
    """
    if not len(x1):
        return np.zeros((0, 3))
    h = cv2.triangulatePoints(np.eye(4)[:3], second_from_first.matrix[:3], x1.T, x2.T)
    w = np.where(np.abs(h[3]) < 1e-12, 1e-12, h[3])
    return (h[:3] / w).T


def parallax_rad(second_from_first: Pose, xyz_in_first: Array) -> Array:
    """Returns parallax angles (N,) [rad] of points (N, 3): between the rays to the two camera centres."""
    centre = second_from_first.inverse().translation
    a, b = xyz_in_first, xyz_in_first - centre
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(1))


def points_from_disparity(camera: Camera, baseline_m: float, uv: Array, disparity_px: Array) -> Array:
    """Returns points (N, 3) [m] in the left camera of a rectified pair; NaN where the disparity is not positive."""
    depth = camera.fx * baseline_m / np.where(disparity_px > 0, disparity_px, np.nan)
    uv = np.asarray(uv, float)
    return np.stack([(uv[:, 0] - camera.cx) / camera.fx * depth, (uv[:, 1] - camera.cy) / camera.fy * depth, depth], 1)
