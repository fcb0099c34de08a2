"""The rolling shutter of a stereo pair: converts observations to those at the exposure of the middle row.

Rectified rows that show the same point are exposed together, so each point has one time and one depth. `motion`
(rolling.mean_rates), a rate and its change, leads from there to the middle row's time. With a hand's shake (4 Hz) a
constant rate would put outer rows of 30 ms 0.7 px off.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ispom.estimators.modern.rolling import mean_rates, moved
from ispom.geometry import Array
from ispom.numerics.reprojection import reprojected
from ispom.numerics.robust import cauchy_weights
from ispom.solvers.localisation import PoseFit
from ispom.types import Camera


@dataclass(frozen=True)
class Shutter:
    """When the rows of the rectified images are exposed."""

    slope_s: float = 0.0
    """Delay [s] per unit of normalised y; 0 for a global shutter."""
    middle: float = 0.0
    """Normalised y of the middle row."""

    @staticmethod
    def of(camera: Camera) -> Shutter:
        """Returns the shutter of a camera."""
        return Shutter(camera.line_delay_s * camera.fy, ((camera.height - 1) / 2 - camera.cy) / camera.fy)

    @property
    def rolls(self) -> bool:
        """Returns whether rows are exposed at different times."""
        return self.slope_s != 0.0

    def late_s(self, y: Array) -> Array:
        """Returns the times (N,) [s], relative to the middle row, at which rows at normalised y (N,) are exposed."""
        return self.slope_s * (y - self.middle)

    def at_middle(self, seen: Array, motion: Array, baseline_m: float) -> Array:
        """Returns observations (N, 3) (see KeyFrame.seen) at the time of the middle row; `motion` (12,) is that of
        left_from_world. The depth is that of the disparity; points without one count as infinitely far."""
        if not self.rolls:
            return seen
        far = np.maximum(np.nan_to_num(seen[:, 0] - seen[:, 2]), 0.0) / baseline_m
        ray = np.column_stack([seen[:, :2], np.ones(len(seen))])
        late_s = self.late_s(seen[:, 1])
        middle = moved(ray, -late_s, mean_rates(motion, late_s), far)
        right = middle[:, 0] - np.where(np.isfinite(seen[:, 2]), baseline_m * far, np.nan)
        # A disparity that is not positive gives no depth, and is kept.
        right = np.where(far > 0, right / middle[:, 2], seen[:, 2] + middle[:, 0] / middle[:, 2] - seen[:, 0])
        return np.column_stack([middle[:, :2] / middle[:, 2:], right])

    def points_at_middle(self, near: Array, motion: Array) -> Array:
        """Returns points (N, 3), in the left camera at the time of their own row, in that of the middle row."""
        if not self.rolls:
            return near
        late_s = self.late_s(near[:, 1] / np.maximum(near[:, 2], 1e-9))
        return moved(near, -late_s, mean_rates(motion, late_s), np.ones(len(near)))

    def as_seen(self, near: Array, motion: Array) -> Array:
        """Returns points (N, 3), in the left camera at the time of the middle row, in that of their own row."""
        if not self.rolls:
            return near
        late_s = self.late_s(np.clip(near[:, 1] / np.maximum(near[:, 2], 1e-9), -10, 10))
        return moved(near, late_s, mean_rates(motion, late_s), np.ones(len(near)))

    def by_motion(self, by_twist: Array, y: Array) -> Array:
        """Returns the Jacobian (N, 3, 12) of observations in rows at y (N,) by the motion; `by_twist` (N, 3, 6) is that
        by a left twist of the pose."""
        late_s = self.late_s(y)[:, None, None]
        return np.concatenate([late_s * by_twist, 0.5 * late_s**2 * by_twist], axis=2)


@dataclass(frozen=True, eq=False)
class MotionPrior:
    """The prior of left_from_world's motion during the exposure of the rows."""

    motion: Array
    """(12,) expected motion, see rolling.mean_rates."""
    sigma: Array
    """(12,) standard deviations."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Map points that a frame observed in rows of different times."""

    shutter: Shutter
    xyz: Array
    """(N, 3) in the world."""
    y: Array
    """(N,) normalised y of the rows that observed them."""
    baseline_m: float
    sigma: float
    """Standard deviation of an observation, and scale of the Cauchy loss, normalised."""

    def refined(self, believed: MotionPrior, motion: Array, middle: Array, fit: PoseFit) -> tuple[Array, PoseFit]:
        """Refines the motion (12,) by one step of least squares over motion and pose, with the prior `believed`.

        `middle` (N, 3) are the observations at the middle row by `motion`. The returned fit has less information, by
        the uncertainty of the motion.
        """
        near = fit.camera_from_world.apply(self.xyz)
        keep = fit.inliers & (near[:, 2] > 1e-6)
        jacobian, _, error = pair_reprojected(near[keep], middle[keep], self.baseline_m)
        weight = cauchy_weights((error**2).sum(axis=1), self.sigma) / self.sigma**2
        by_motion = self.shutter.by_motion(jacobian, self.y[keep])
        weighted = by_motion * weight[:, None, None]
        cross, own = (np.einsum("nki,nkj->ij", weighted, other) for other in (jacobian, by_motion))
        of_pose = np.einsum("nki,nkj,n->ij", jacobian, jacobian, weight)
        hessian = np.block([[of_pose, cross.T], [cross, own + np.diag(believed.sigma**-2.0)]])
        right = np.concatenate(
            [
                np.einsum("nki,nk,n->i", jacobian, error, weight),
                np.einsum("nki,nk->i", weighted, error) + (believed.motion - motion) / believed.sigma**2,
            ]
        )
        step = np.linalg.solve(hessian, right)
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
    turned = np.hstack([row, np.cross(near, row)])
    error = np.column_stack([seen[:, :2] - uv, np.where(known, seen[:, 2] - right[:, 0], 0.0)])
    return np.concatenate([by_twist, turned[:, None]], axis=1), by_point, error
