"""A rolling shutter of the pair: what it would have seen, had all rows been exposed with the middle one.

Rows of the two rectified images that show the same point are exposed together: each point is seen by a pair whose rows
have one time, and one depth. The motion from there to the middle row's time is what `rate` says.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ispom.estimators.modern.rolling import moved
from ispom.geometry import Array
from ispom.numerics.reprojection import reprojected
from ispom.solvers.motion_only import PoseFit
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

    def at_middle(self, seen: Array, rate: Array, baseline_m: float) -> Array:
        """Observations (N, 3) (see KeyFrame.seen) as they were with the middle row; `rate` (6,) of left_from_world.

        The depth is that of the disparity; without one the point is held to be far.
        """
        if not self.rolls:
            return seen
        far = np.maximum(np.nan_to_num(seen[:, 0] - seen[:, 2]), 0.0) / baseline_m
        ray = np.column_stack([seen[:, :2], np.ones(len(seen))])
        middle = moved(ray, -self.late_s(seen[:, 1]), rate, far)
        right = middle[:, 0] - np.where(np.isfinite(seen[:, 2]), baseline_m * far, np.nan)
        # What has no positive disparity keeps it, and moves with the left image's point.
        right = np.where(far > 0, right / middle[:, 2], seen[:, 2] + middle[:, 0] / middle[:, 2] - seen[:, 0])
        return np.column_stack([middle[:, :2] / middle[:, 2:], right])

    def points_at_middle(self, near: Array, rate: Array) -> Array:
        """Points (N, 3) in the left camera of the row that sees them, in that of the middle row."""
        if not self.rolls:
            return near
        y = near[:, 1] / np.maximum(near[:, 2], 1e-9)
        return moved(near, -self.late_s(y), rate, np.ones(len(near)))

    def as_seen(self, near: Array, rate: Array) -> Array:
        """Points (N, 3) in the left camera of the middle row, in that of the row that sees them."""
        if not self.rolls:
            return near
        y = np.clip(near[:, 1] / np.maximum(near[:, 2], 1e-9), -10, 10)
        return moved(near, self.late_s(y), rate, np.ones(len(near)))


@dataclass(frozen=True, eq=False)
class RateBelief:
    """What is known about how left_from_world changes, before a pair is looked at."""

    rate: Array
    """(6,) (rho [m/s], phi [rad/s]; left)."""
    sigma: Array
    """(6,) its standard deviations."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Known points that a pair saw in rows of different times."""

    shutter: Shutter
    xyz: Array
    """(N, 3) in the world."""
    seen: Array
    """(N, 3) as KeyFrame.seen."""
    baseline_m: float
    sigma: float
    """Standard deviation of what was seen, normalised."""

    def refined(self, believed: RateBelief, rate: Array, fit: PoseFit) -> tuple[Array, PoseFit]:
        """The rate (6,) that, with a change of the pose, explains what `rate` and the fit leave of the errors; and the
        fit, as much less sure as the rate is unknown."""
        near = fit.camera_from_world.apply(self.xyz)
        keep = fit.inliers & (near[:, 2] > 1e-6)
        middle = self.shutter.at_middle(self.seen[keep], rate, self.baseline_m)
        jacobian, _, error = pair_reprojected(near[keep], middle, self.baseline_m)
        weight = 1 / (self.sigma**2 + (error**2).sum(axis=1))
        by_rate = jacobian * self.shutter.late_s(self.seen[keep, 1])[:, None, None]
        weighted = by_rate * weight[:, None, None]
        cross, own = (np.einsum("nki,nkj->ij", weighted, other) for other in (jacobian, by_rate))
        of_pose = np.einsum("nki,nkj,n->ij", jacobian, jacobian, weight)
        hessian = np.block([[of_pose, cross.T], [cross, own + np.diag(believed.sigma**-2.0)]])
        right = np.concatenate(
            [
                np.einsum("nki,nk,n->i", jacobian, error, weight),
                np.einsum("nki,nk->i", weighted, error) + (believed.rate - rate) / believed.sigma**2,
            ]
        )
        step = np.linalg.solve(hessian, right)
        information = fit.information - cross.T @ np.linalg.solve(hessian[6:, 6:], cross)
        return rate + step[6:], replace(fit, information=information)


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
