"""Triangulates points from all their views, by inverse depth in the first view (Civera et al. 2008)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.numerics.robust import Noise, robust_weights

ITERATIONS = 6
"""Number of iterations of weights and depths."""
LOSS_FACTOR = 3.0
"""Width of the loss, relative to that of bundle adjustment: poses are fixed, so residuals include their errors."""


@dataclass(frozen=True, eq=False)
class InverseDepths:
    """Triangulated points with their quality."""

    xyz_in_world: Array
    """(M, 3) points; meaningless where `depth` is not positive."""
    depth: Array
    """(M,) depth in the first view; not positive if at or beyond infinity, or behind the view."""
    significance: Array
    """(M,) inverse depth divided by its standard deviation, for the given noise."""
    worst: Array
    """(M,) largest reprojection error over the views, normalised units; inf behind a view. Where `depth` is not
    positive it is that of a point at infinity."""
    parallax_rad: Array
    """(M,) largest angle between the first view's ray and another view's."""


def intersect(
    rotations: Array, translations: Array, cameras: NDArray[np.int64], owners: NDArray[np.int64], seen: Array,
    count: int, noise: Noise,
) -> InverseDepths:  # fmt: skip
    """Triangulates `count` points, each along the ray of its first observation.

    Views are camera_from_world: (C, 3, 3), (C, 3). Observation k is normalised coordinates seen[k] (2,) of point
    owners[k] in view cameras[k], sorted by point; `noise` is that of a coordinate. Solves weighted linear equations in
    one unknown repeatedly, with the last depths and robust weights of LOSS_FACTOR loss widths.
    """
    begin = np.searchsorted(owners, owners)
    origin, ray = cameras[begin], np.column_stack([seen[begin], np.ones(len(begin))])
    back = np.swapaxes(rotations[origin], 1, 2)
    later = np.arange(len(owners)) > begin
    owner, turn, x = owners[later], rotations[cameras[later]], seen[later]
    # In another view a point is q + rho t: the rotated ray, and inverse depth times the translation.
    q = _turned(turn, _turned(back, ray)[later])
    t = translations[cameras[later]] - _turned(turn, _turned(back, translations[origin])[later])
    offset, slopes = q[:, :2] - x * q[:, 2:], t[:, :2] - x * t[:, 2:]
    rho, information = np.zeros(count), np.ones(count)
    for _ in range(ITERATIONS):
        near = rho[owner][:, None]
        z = np.maximum(q[:, 2:] + near * t[:, 2:], 1e-3)
        slope, value = slopes / z, offset / z
        weights = robust_weights((value + slope * near) ** 2, LOSS_FACTOR * noise.width)
        weighted = np.where(near != 0, weights, 1.0) * slope
        information = 1e-12 + np.bincount(owner, (weighted * slope).sum(axis=1), count)
        rho = -np.bincount(owner, (weighted * value).sum(axis=1), count) / information
    finite = rho > 1e-9
    near = np.where(finite, rho, 0.0)[owner]
    y = q + near[:, None] * t
    front = y[:, 2] > 1e-6 * np.where(near > 0, near, 1.0)
    error = np.linalg.norm(y[:, :2] / np.where(front, y[:, 2], 1.0)[:, None] - x, axis=1)
    cosine = (q * y).sum(axis=1) / np.sqrt((q * q).sum(axis=1) * (y * y).sum(axis=1))
    angle = np.where(front & (near > 0), np.arccos(np.clip(cosine, -1.0, 1.0)), 0.0)
    worst, parallax = np.full(count, np.inf), np.zeros(count)
    worst[owners] = 0.0
    np.maximum.at(worst, owner, np.where(front, error, np.inf))
    np.maximum.at(parallax, owner, angle)
    depth = np.where(finite, 1 / np.where(finite, rho, 1.0), -1.0)
    first, xyz = begin[~later], np.zeros((count, 3))
    m = owners[first]
    xyz[m] = _turned(back[first], ray[first] * depth[m, None] - translations[origin[first]])
    significance = np.where(finite, rho * np.sqrt(information) / noise.sigma, 0.0)
    return InverseDepths(xyz, depth, significance, worst, parallax)


def _turned(rotations: Array, xyz: Array) -> Array:
    """Rotates vectors (N, 3), each by its own rotation (N, 3, 3)."""
    return (rotations @ xyz[:, :, None])[..., 0]
