"""Solves triples of keyframes with common points, and transfers their scale (section 6.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.numerics.robust import normalised_mad
from ispom.solvers.localisation import resect
from ispom.solvers.multiview.essential import relative_pose
from ispom.solvers.multiview.triangulation import parallax_rad, triangulate

ScaleTransfer = Literal["norm", "vector", "depth", "unit"]


@dataclass(frozen=True, eq=False)
class Triple:
    """Poses of cameras 1, 2, 3 in the unit |T13| = 1; T is the centre of a camera in the frame of camera 1."""

    second_from_first: Pose
    third_from_first: Pose
    xyz_in_first: Array
    """(N, 3) triangulated points; NaN for epipolar outliers and points behind a camera."""
    epipolar: NDArray[np.bool_]
    """(N,) whether a point fits the relative pose of 1 and 3."""
    residuals: Array
    """(N,) reprojection errors in camera 2, normalised units; inf or NaN where the point has no position."""
    resected: NDArray[np.bool_]
    """(N,) whether the residual is within the threshold."""

    @property
    def t12(self) -> Array:
        """Returns the centre (3,) of camera 2 in camera 1."""
        return self.second_from_first.inverse().translation

    @property
    def t13(self) -> Array:
        """Returns the centre (3,) of camera 3 in camera 1."""
        return self.third_from_first.inverse().translation


def solve_triple(x1: Array, x2: Array, x3: Array, threshold: float, min_parallax_rad: float) -> Triple | None:
    """Solves three cameras from normalised coordinates (N, 2) of the same points; None if a step fails.

    Steps: relative pose of 1 and 3, triangulation, resection of 2. Points with a parallax below `min_parallax_rad` are
    too uncertain for resection and are skipped, unless fewer than 20 would remain.
    """
    relative = relative_pose(x1, x3, threshold)
    if relative is None:
        return None
    third_from_first, good = relative.second_from_first, relative.inliers
    xyz = np.full((len(x1), 3), np.nan)
    xyz[good] = triangulate(third_from_first, x1[good], x3[good])
    deep = good & (xyz[:, 2] > 0) & (third_from_first.apply(xyz)[:, 2] > 0)
    angle = np.zeros(len(x1))
    angle[deep] = parallax_rad(third_from_first, xyz[deep])
    wide = deep & (angle >= min_parallax_rad)
    usable = wide if wide.sum() >= 20 else deep
    xyz[~usable] = np.nan
    resection = resect(xyz[usable], x2[usable], threshold)
    if resection is None:
        return None
    residuals, resected = np.full(len(x1), np.nan), np.zeros(len(x1), bool)
    residuals[usable], resected[usable] = resection.distances, resection.inliers
    return Triple(resection.camera_from_world, third_from_first, xyz, good, residuals, resected)


def step_length(triple: Triple, transfer: ScaleTransfer) -> float:
    """Returns |T23| in the triple's unit: as printed |T13| - |T12| for `norm`, else the length of T13 - T12.

    The printed form is correct only for collinear centres, and never too long. It is not positive if camera 2 is
    farther from camera 1 than camera 3 is: callers must check.
    """
    if transfer == "norm":
        return float(np.linalg.norm(triple.t13) - np.linalg.norm(triple.t12))
    return float(np.linalg.norm(triple.t13 - triple.t12))


def depth_ratio(known_depths: Array, triple_depths: Array) -> tuple[float, float]:
    """Returns the scale factor from depths (N,) of shared points, and its scatter (normalised MAD of logarithms).

    The factor is the median of known depth over triple depth. (nan, nan) with fewer than 8 points.
    """
    positive = (known_depths > 0) & (triple_depths > 0)
    if positive.sum() < 8:
        return np.nan, np.nan
    log_ratio = np.log(known_depths[positive] / triple_depths[positive])
    return float(np.exp(np.median(log_ratio))), normalised_mad(log_ratio)
