"""Three key frames with common points, and handing their unit to the next three (section 6.1)."""

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
    """Cameras 1, 2, 3 in the unit |T13| = 1; T is the centre of a camera, seen from camera 1."""

    second_from_first: Pose
    third_from_first: Pose
    xyz_in_first: Array
    """(N, 3) the forward intersections; NaN of points that fit no epipolar line or are not in front."""
    epipolar: NDArray[np.bool_]
    """(N,) consistent with the relative pose of 1 and 3."""
    residuals: Array
    """(N,) reprojection errors in camera 2, normalised units; inf or NaN where the point has no position."""
    resected: NDArray[np.bool_]
    """(N,) within the threshold in camera 2."""

    @property
    def t12(self) -> Array:
        return self.second_from_first.inverse().translation

    @property
    def t13(self) -> Array:
        return self.third_from_first.inverse().translation


def solve_triple(x1: Array, x2: Array, x3: Array, threshold: float, min_parallax_rad: float) -> Triple | None:
    """From normalised coordinates (N, 2) of the same points in three images. None where a step fails.

    Relative pose of 1 and 3, forward intersection, resection of 2. Points seen under less than
    `min_parallax_rad` are too uncertain to resect from and are skipped, unless few would remain.
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
    """|T23| in the triple's unit: as printed |T13| - |T12| for `norm`, else the length of T13 - T12.

    The printed form is right only for collinear centres, never too long, and not positive where camera 2 lies
    farther from camera 1 than camera 3 does: callers must check.
    """
    if transfer == "norm":
        return float(np.linalg.norm(triple.t13) - np.linalg.norm(triple.t12))
    return float(np.linalg.norm(triple.t13 - triple.t12))


def depth_ratio(known_depths: Array, triple_depths: Array) -> tuple[float, float]:
    """Known unit per triple unit from depths (N,) of shared points: median, and its spread (normalised MAD of logs).

    (nan, nan) with fewer than 8 points.
    """
    positive = (known_depths > 0) & (triple_depths > 0)
    if positive.sum() < 8:
        return np.nan, np.nan
    log_ratio = np.log(known_depths[positive] / triple_depths[positive])
    return float(np.exp(np.median(log_ratio))), normalised_mad(log_ratio)
