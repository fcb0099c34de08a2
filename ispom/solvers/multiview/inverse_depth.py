"""Points by their inverse depth in the view that saw them first, from all views that see them (Civera et al. 2008)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.numerics.robust import Noise, cauchy_weights

ROUNDS = 6
"""Of weights and depths: more change nothing that counts."""
WIDER = 3.0
"""Width of the loss here over that of bundle adjustment: the poses are held, and their errors come in addition."""


@dataclass(frozen=True, eq=False)
class InverseDepths:
    xyz_in_world: Array
    """(M, 3); meaningless where `depth` is not positive."""
    depth: Array
    """(M,) in the first view; not positive: at or beyond infinity, or behind."""
    significance: Array
    """(M,) inverse depth over its standard deviation at the noise given."""
    worst: Array
    """(M,) largest reprojection error over the views, normalised units; inf behind a view.
    Where `depth` is not positive that of a point at infinity."""
    parallax_rad: Array
    """(M,) largest angle between the first view's ray and another view's."""


def intersect(
    rotations: Array, translations: Array, cameras: NDArray[np.int64], owners: NDArray[np.int64], seen: Array,
    count: int, noise: Noise,
) -> InverseDepths:  # fmt: skip
    """Intersects the rays of `count` points, each along the ray of its first observation.

    Views are camera_from_world: (C, 3, 3), (C, 3). Observation k is normalised coordinates seen[k] (2,) of point
    owners[k] in view cameras[k], sorted by point; `noise` that of a coordinate. Weighted linear equations in
    the one unknown, repeated with the depths of the last round and Cauchy weights of WIDER widths of the loss.
    """
    begin = np.searchsorted(owners, owners)
    origin, ray = cameras[begin], np.column_stack([seen[begin], np.ones(len(begin))])
    back = np.swapaxes(rotations[origin], 1, 2)
    later = np.arange(len(owners)) > begin
    owner, turn, x = owners[later], rotations[cameras[later]], seen[later]
    # In another view, the ray turned and the step from the first view, by how near the point is.
    q = _turned(turn, _turned(back, ray)[later])
    t = translations[cameras[later]] - _turned(turn, _turned(back, translations[origin])[later])
    offset, slopes = q[:, :2] - x * q[:, 2:], t[:, :2] - x * t[:, 2:]
    rho, information = np.zeros(count), np.ones(count)
    for _ in range(ROUNDS):
        near = rho[owner][:, None]
        z = np.maximum(q[:, 2:] + near * t[:, 2:], 1e-3)
        slope, value = slopes / z, offset / z
        weights = cauchy_weights((value + slope * near) ** 2, WIDER * noise.width)
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
    """(N, 3), each by its own rotation (N, 3, 3)."""
    return (rotations @ xyz[:, :, None])[..., 0]
