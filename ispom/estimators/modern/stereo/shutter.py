"""The rolling shutter of a stereo pair: observations at the time of the middle row, and the motion of a single frame.

Rectified rows that show the same point are exposed together, so each point has one time and one depth.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ispom.estimators.modern.rolling import at_middle, at_rows, late_s
from ispom.geometry import Array
from ispom.numerics.reprojection import reprojected
from ispom.numerics.robust import robust_weights
from ispom.solvers.localisation import PoseFit
from ispom.types import Camera


def row_times(camera: Camera, y: Array) -> Array | None:
    """Returns the exposure times (N,) [s], relative to the middle row, of rectified rows at normalised y (N,); None for
    a global shutter."""
    return late_s(camera, camera.fy * y + camera.cy) if camera.line_delay_s else None


def pair_at_middle(seen: Array, late_s: Array | None, motion: Array, baseline_m: float) -> Array:
    """Returns observations (N, 3) (see KeyFrame.seen), exposed at `late_s` (N,), at the time of the middle row.

    The motion (12,) is that of left_from_world, see rolling.steady. The depth is that of the disparity; points without
    one count as infinitely far. A global shutter changes nothing.
    """
    if late_s is None:
        return seen
    far = np.maximum(np.nan_to_num(seen[:, 0] - seen[:, 2]), 0.0) / baseline_m
    middle = at_middle(np.column_stack([seen[:, :2], np.ones(len(seen))]), late_s, motion, far)
    right = middle[:, 0] - np.where(np.isfinite(seen[:, 2]), baseline_m * far, np.nan)
    # A disparity that is not positive gives no depth, and is kept.
    right = np.where(far > 0, right / middle[:, 2], seen[:, 2] + middle[:, 0] / middle[:, 2] - seen[:, 0])
    return np.column_stack([middle[:, :2] / middle[:, 2:], right])


def points_at_middle(camera: Camera, near: Array, motion: Array) -> Array:
    """Returns points (N, 3), in the left camera at the times of their rows, in that of the middle row."""
    late_s = row_times(camera, near[:, 1] / np.maximum(near[:, 2], 1e-9))
    return near if late_s is None else at_middle(near, late_s, motion, np.ones(len(near)))


def points_at_rows(camera: Camera, near: Array, motion: Array) -> Array:
    """Returns points (N, 3), in the left camera at the time of the middle row, in that at the times of their rows."""
    late_s = row_times(camera, np.clip(near[:, 1] / np.maximum(near[:, 2], 1e-9), -10, 10))
    return near if late_s is None else at_rows(near, late_s, motion)


@dataclass(frozen=True, eq=False)
class MotionPrior:
    """The prior of left_from_world's motion during the exposure of the rows."""

    motion: Array
    """(12,) expected motion, see rolling.steady."""
    sigma: Array
    """(12,) standard deviations."""


def refined_motion(
    xyz: Array,
    middle: Array,
    late_s: Array,
    baseline_m: float,
    width: float,
    expected: MotionPrior,
    motion: Array,
    fit: PoseFit,
) -> tuple[Array, PoseFit]:
    """Refines the motion (12,) of a frame by one step of least squares over motion and pose, with a prior.

    The points (N, 3) of the world were observed in rows of times `late_s` (N,); `middle` (N, 3) are the observations at
    the middle row by `motion`, `width` that of the robust loss, normalised. The returned fit has less information, by
    the uncertainty of the motion.
    """
    near = fit.camera_from_world.apply(xyz)
    keep = fit.inliers & (near[:, 2] > 1e-6)
    by_twist, _, error = pair_reprojected(near[keep], middle[keep], baseline_m)
    weight, late = robust_weights((error**2).sum(axis=1), width) / width**2, late_s[keep, None, None]
    unknowns = np.concatenate([by_twist, late * by_twist, 0.5 * late**2 * by_twist], axis=2)
    weighted = unknowns * weight[:, None, None]
    hessian = np.einsum("nki,nkj->ij", weighted, unknowns)
    right = np.einsum("nki,nk->i", weighted, error)
    hessian[6:, 6:] += np.diag(expected.sigma**-2.0)
    right[6:] += (expected.motion - motion) / expected.sigma**2
    step, cross = np.linalg.solve(hessian, right), hessian[6:, :6]
    information = fit.information - cross.T @ np.linalg.solve(hessian[6:, 6:], cross)
    return motion + step[6:], replace(fit, information=information)


def pair_reprojected(near: Array, seen: Array, baseline_m: float) -> tuple[Array, Array, Array]:
    """Returns the Jacobians of x, y and right x of points (N, 3) in the left camera, and the residuals (N, 3).

    The Jacobians are by a left twist of the pose (N, 3, 6) and by the point in the camera (N, 3, 3). Residuals are
    observed minus projected. An unknown right x has zeros.
    """
    uv, of_left, by_twist = reprojected(near)
    right, of_right, _ = reprojected(near - (baseline_m, 0, 0))
    known = np.isfinite(seen[:, 2])
    row = of_right[:, 0] * known[:, None]
    by_point = np.concatenate([of_left, row[:, None]], axis=1)
    error = np.column_stack([seen[:, :2] - uv, np.where(known, seen[:, 2] - right[:, 0], 0.0)])
    return np.concatenate([by_twist, np.hstack([row, np.cross(near, row)])[:, None]], axis=1), by_point, error
