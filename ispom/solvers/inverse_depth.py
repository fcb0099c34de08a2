"""Points by their inverse depth in the view that saw them first, from all views that see them (Civera et al. 2008)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ispom.geometry import Array


@dataclass(frozen=True, eq=False)
class InverseDepths:
    xyz_in_world: Array
    """(M, 3); meaningless where `depth` is not positive."""
    depth: Array
    """(M,) in the first view; not positive: at or beyond infinity, or behind."""
    significance: Array
    """(M,) inverse depth over its standard deviation at one unit of `sigma`."""
    worst: Array
    """(M,) largest reprojection error over the views, normalised units; inf behind a view.
    Where `depth` is not positive that of a point at infinity."""
    parallax_rad: Array
    """(M,) largest angle between the first view's ray and another view's."""


def intersect(
    rotations: Array, translations: Array, cameras: NDArray[np.int64], owners: NDArray[np.int64], seen: Array,
    count: int, sigma: float,
) -> InverseDepths:  # fmt: skip
    """Intersects the rays of `count` points, each along the ray of its first observation.

    Views are camera_from_world: (C, 3, 3), (C, 3). Observation k is normalised coordinates seen[k] (2,) of point
    owners[k] in view cameras[k], sorted by point; `sigma` is the deviation of a coordinate. Weighted linear
    equations in the one unknown, repeated with the depths of the last round and Cauchy weights.
    """
    return InverseDepths(
        *_intersect(np.ascontiguousarray(rotations), translations, cameras, owners, seen, count, sigma)
    )


@njit(cache=True)
def _intersect(rotations, translations, cameras, owners, seen, count, sigma):
    xyz, depth, significance = np.zeros((count, 3)), np.full(count, -1.0), np.zeros(count)
    worst, parallax = np.full(count, np.inf), np.zeros(count)
    k = 0
    while k < len(owners):
        m, begin = owners[k], k
        while k < len(owners) and owners[k] == m:
            k += 1
        a = cameras[begin]
        back = np.ascontiguousarray(rotations[a].T)
        ray = np.array([seen[begin, 0], seen[begin, 1], 1.0])
        rho, information = 0.0, 0.0
        for _ in range(6):
            information, side = 1e-12, 0.0
            for i in range(begin + 1, k):
                turn = rotations[cameras[i]] @ back
                t = translations[cameras[i]] - turn @ translations[a]
                q = turn @ ray
                z = q[2] + rho * t[2]
                if z <= 1e-3:
                    z = 1e-3
                for axis in range(2):
                    slope = (t[axis] - seen[i, axis] * t[2]) / z
                    value = (q[axis] - seen[i, axis] * q[2]) / z
                    error = (value + slope * rho) / (3 * sigma)
                    weight = 1.0 / (1.0 + error * error) if information >= 0 and rho != 0.0 else 1.0
                    information += weight * slope * slope
                    side -= weight * slope * value
            rho = side / information
        if rho <= 1e-9:
            worst[m] = 0.0
            for i in range(begin + 1, k):
                q = rotations[cameras[i]] @ back @ ray
                error = (
                    np.sqrt((q[0] / q[2] - seen[i, 0]) ** 2 + (q[1] / q[2] - seen[i, 1]) ** 2)
                    if q[2] > 1e-6
                    else np.inf
                )
                worst[m] = max(worst[m], error)
            continue
        p = ray / rho
        worst[m] = 0.0
        for i in range(begin + 1, k):
            turn = rotations[cameras[i]] @ back
            q = turn @ ray
            y = turn @ p + translations[cameras[i]] - turn @ translations[a]
            if y[2] <= 1e-6:
                worst[m] = np.inf
                continue
            error = np.sqrt((y[0] / y[2] - seen[i, 0]) ** 2 + (y[1] / y[2] - seen[i, 1]) ** 2)
            worst[m] = max(worst[m], error)
            cosine = (q @ y) / np.sqrt((q @ q) * (y @ y))
            parallax[m] = max(parallax[m], np.arccos(min(1.0, cosine)))
        xyz[m] = back @ (p - translations[a])
        depth[m] = p[2]
        significance[m] = rho * np.sqrt(information) / sigma
    return xyz, depth, significance, worst, parallax
