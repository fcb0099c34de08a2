"""A rolling shutter of the pair: what it would have seen, had all rows been exposed with the middle one.

Rows of the two rectified images that show the same point are exposed together: each point is seen by a pair whose rows
have one time, and one depth. The way from there to the middle row's time is what `motion` says (rolling.mean_rates): a
rate and its change; by a hand's shake (4 Hz) outer rows of 30 ms are 0.7 px from where one rate alone would lead.
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
    """By how much later a row is than one that is 1 higher in normalised coordinates; 0 unless the shutter rolls."""
    middle: float = 0.0
    """Normalised y of the middle row."""

    @staticmethod
    def of(camera: Camera) -> Shutter:
        return Shutter(camera.line_delay_s * camera.fy, ((camera.height - 1) / 2 - camera.cy) / camera.fy)

    @property
    def rolls(self) -> bool:
        return self.slope_s != 0.0

    def late_s(self, y: Array) -> Array:
        """(N,) [s] after the middle row are rows at y (N,), normalised, exposed."""
        return self.slope_s * (y - self.middle)

    def at_middle(self, seen: Array, motion: Array, baseline_m: float) -> Array:
        """Observations (N, 3) (see KeyFrame.seen) as they were with the middle row; `motion` (12,) of left_from_world.

        The depth is that of the disparity; without one the point is held to be far.
        """
        if not self.rolls:
            return seen
        far = np.maximum(np.nan_to_num(seen[:, 0] - seen[:, 2]), 0.0) / baseline_m
        ray = np.column_stack([seen[:, :2], np.ones(len(seen))])
        late_s = self.late_s(seen[:, 1])
        middle = moved(ray, -late_s, mean_rates(motion, late_s), far)
        right = middle[:, 0] - np.where(np.isfinite(seen[:, 2]), baseline_m * far, np.nan)
        # What has no positive disparity keeps it, and moves with the left image's point.
        right = np.where(far > 0, right / middle[:, 2], seen[:, 2] + middle[:, 0] / middle[:, 2] - seen[:, 0])
        return np.column_stack([middle[:, :2] / middle[:, 2:], right])

    def points_at_middle(self, near: Array, motion: Array) -> Array:
        """Points (N, 3) in the left camera of the row that sees them, in that of the middle row."""
        if not self.rolls:
            return near
        late_s = self.late_s(near[:, 1] / np.maximum(near[:, 2], 1e-9))
        return moved(near, -late_s, mean_rates(motion, late_s), np.ones(len(near)))

    def as_seen(self, near: Array, motion: Array) -> Array:
        """Points (N, 3) in the left camera of the middle row, in that of the row that sees them."""
        if not self.rolls:
            return near
        late_s = self.late_s(np.clip(near[:, 1] / np.maximum(near[:, 2], 1e-9), -10, 10))
        return moved(near, late_s, mean_rates(motion, late_s), np.ones(len(near)))

    def by_motion(self, by_twist: Array, y: Array) -> Array:
        """(N, 3, 12) how what is seen in rows at y (N,) follows the motion, if it follows a left twist of the pose by
        (N, 3, 6)."""
        late_s = self.late_s(y)[:, None, None]
        return np.concatenate([late_s * by_twist, 0.5 * late_s**2 * by_twist], axis=2)


@dataclass(frozen=True, eq=False)
class MotionPrior:
    """What is known about how left_from_world moves while rows are exposed, before they are looked at."""

    motion: Array
    """(12,)."""
    sigma: Array
    """(12,) its standard deviations."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Known points that a pair saw in rows of different times."""

    shutter: Shutter
    xyz: Array
    """(N, 3) in the world."""
    y: Array
    """(N,) of the rows that saw them, normalised."""
    baseline_m: float
    sigma: float
    """Standard deviation of what was seen, normalised."""

    def refined(self, believed: MotionPrior, motion: Array, middle: Array, fit: PoseFit) -> tuple[Array, PoseFit]:
        """The motion (12,) that, with a change of the pose, explains what the fit leaves of the errors, if by `motion`
        the middle row saw the points at (N, 3), `middle`; and the fit, as much less sure as the motion is unknown."""
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
    """How x, y and the right x of points (N, 3) in the left camera follow a left twist of its pose (N, 3, 6) and the
    point there (N, 3, 3), and where they were seen (N, 3) minus where they are; zeros where the right x is unknown."""
    uv, of_left, by_twist = reprojected(near)
    right, of_right, _ = reprojected(near - (baseline_m, 0, 0))
    known = np.isfinite(seen[:, 2])
    row = of_right[:, 0] * known[:, None]
    by_point = np.concatenate([of_left, row[:, None]], axis=1)
    turned = np.hstack([row, np.cross(near, row)])
    error = np.column_stack([seen[:, :2] - uv, np.where(known, seen[:, 2] - right[:, 0], 0.0)])
    return np.concatenate([by_twist, turned[:, None]], axis=1), by_point, error
