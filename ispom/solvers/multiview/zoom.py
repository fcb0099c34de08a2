"""Finds the rotation and zoom that explain most of an image motion: the infinite homography of a camera at rest.

Hartley & Zisserman 2004, 8.4 and 19.6: images of a camera that rotates about its centre and zooms are related by
K2 R K1^-1. The focal length may be only a guess, so that of the first image is estimated as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ispom.geometry import Array, so3_exp
from ispom.numerics.area import weighted_median
from ispom.numerics.levenberg_marquardt import minimise
from ispom.numerics.robust import robust_weights
from ispom.solvers.multiview.rotation import dominant_rotation

FOCAL_FACTORS = (1.0, 0.7, 1.4)
"""Start values of the focal length, relative to the given one."""
FOCAL_RANGE = (0.55, 1.8)
"""Range of the focal length, relative to the given one: two standard deviations (30 % each) of a guess. A longer one
would explain any image shift of a plane."""
MAX_ITERATIONS, TOLERANCE = 20, 1e-4
"""Largest number of steps, and the relative decrease of the cost that ends them: only a median distance is computed
from the result."""
DERIVATIVE_STEP = 1e-6
"""Relative step of the numerical derivative by the focal length."""


@dataclass(frozen=True, eq=False)
class TurnAndZoom:
    """The motion of a camera that only rotates and zooms."""

    rotation: Array
    """(3, 3) second_from_first."""
    zoom: float
    """Focal length of the second image, relative to the first."""
    focal: float
    """Focal length of the first image, relative to the given one."""

    def moved(self, x: Array) -> Array:
        """Maps points (N, 2) of the first image into the second; both are normalised by the given camera."""
        seen = _turned(self.rotation, x / self.focal)
        return self.focal * self.zoom * seen[:, :2] / seen[:, 2:]

    def distances(self, x1: Array, x2: Array) -> Array:
        """Returns the distances (N,) of the mapped points from `x2` (N, 2)."""
        return np.linalg.norm(self.moved(x1) - x2, axis=1)


def turn_and_zoom(x1: Array, x2: Array, scale: float, weights: Array | None = None) -> TurnAndZoom:
    """Finds the motion of least weighted median distance for normalised coordinates (N, 2), N >= 3, in two images.

    Runs robust least squares (of width `scale` in normalised units) over rotation, zoom and focal length from
    several starts; each point has its weight (N,).
    """
    weights = np.ones(len(x1)) if weights is None else weights
    begun = [TurnAndZoom(np.eye(3), 1.0, 1.0)]  # a camera on a tripod, with moving objects
    for focal in FOCAL_FACTORS:
        rotation = dominant_rotation(x1 / focal, x2 / focal, scale / focal, weights=weights)
        begun.append(TurnAndZoom(rotation, 1.0, focal))
    found = [_fitted(start, x1, x2, scale, weights) for start in begun]
    return min(found, key=lambda each: weighted_median(each.distances(x1, x2), weights))


def _fitted(start: TurnAndZoom, x1: Array, x2: Array, scale: float, weights: Array) -> TurnAndZoom:
    """Minimises the robust cost by Levenberg-Marquardt."""

    def cost(values: TurnAndZoom) -> float:
        return float(weights @ np.log1p((values.distances(x1, x2) / scale) ** 2))

    def stepped(values: TurnAndZoom, damping: float) -> TurnAndZoom:
        at = values.moved(x1)
        error = x2 - at
        weight = weights * robust_weights((error**2).sum(axis=1), scale)
        by = _derivatives(values, x1, at)
        normal = np.einsum("n,nik,nil->kl", weight, by, by)
        normal += damping * np.diag(np.diag(normal)) + 1e-12 * np.eye(5)
        step = np.linalg.solve(normal, np.einsum("n,nik,ni->k", weight, by, error))
        zoom, longer = np.exp(np.clip(step[3:], -0.5, 0.5))
        focal = float(np.clip(values.focal * longer, *FOCAL_RANGE))
        return TurnAndZoom(so3_exp(step[:3]) @ values.rotation, values.zoom * float(zoom), focal)

    return minimise(start, cost, stepped, MAX_ITERATIONS, TOLERANCE).values


def _derivatives(of: TurnAndZoom, x1: Array, at: Array) -> Array:
    """Returns the Jacobian (N, 2, 5) of positions by a left rotation and the logarithms of zoom and focal length."""
    ray = _turned(of.rotation, x1 / of.focal)
    x, y = (ray[:, :2] / ray[:, 2:]).T
    one = np.ones_like(x)
    by_rotation = np.stack([np.stack([-x * y, one + x * x, -y], 1), np.stack([-one - y * y, x * y, x], 1)], 1)
    by_focal = (replace(of, focal=of.focal * (1 + DERIVATIVE_STEP)).moved(x1) - at) / DERIVATIVE_STEP
    return np.concatenate([of.focal * of.zoom * by_rotation, at[:, :, None], by_focal[:, :, None]], axis=2)


def _turned(rotation: Array, x: Array) -> Array:
    """Returns rotated rays (N, 3); z is at least 1e-3, also for rays that would be behind the camera."""
    ray = x @ rotation[:, :2].T + rotation[:, 2]
    ray[:, 2] = np.maximum(ray[:, 2], 1e-3)
    return ray
