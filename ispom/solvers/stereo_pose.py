"""Motion-only pose of one camera or a rectified pair: reprojection in both images, robust (modern form of 6.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ispom.geometry import Array, Pose


@dataclass(frozen=True, eq=False)
class Located:
    camera_from_world: Pose
    distances: Array
    """(N,) reprojection errors over both images, normalised; 1e9 behind the camera."""
    inliers: NDArray[np.bool_]
    """(N,) distances within the threshold."""
    information: Array
    """(6, 6) of the left twist (rho, phi), the loss's scale taken as the standard deviation."""


def locate(
    xyz: Array,
    seen: Array,
    guess: Pose,
    baseline: float,
    offset: float,
    scale: float,
    threshold: float,
    prior: Array | None = None,
) -> Located | None:
    """camera_from_world from points (N, 3) and normalised (x, y, right x) (N, 3), right x NaN where unknown.

    `offset` is what rectification and shutter add to the right x, times 1 + x^2 (see window.Window). Gauss-Newton with
    Cauchy weights, wide at first. `prior` (6, 6): information of the guess itself, which holds what the points leave
    open. None with fewer than 6 inliers.
    """
    if len(xyz) < 6:
        return None
    held = np.zeros((6, 6)) if prior is None else prior
    rotation, translation, distances, information, fine = _refine(
        xyz, seen, guess.rotation, guess.translation, baseline, float(offset), scale, held
    )
    inliers = distances <= threshold
    if not fine or inliers.sum() < 6:
        return None
    return Located(Pose(rotation, translation), distances, inliers, information)


@njit(cache=True)
def _exp(phi):
    angle2 = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    angle = np.sqrt(angle2)
    if angle < 1e-6:
        a, b = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    else:
        a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2
    k = np.array([[0.0, -phi[2], phi[1]], [phi[2], 0.0, -phi[0]], [-phi[1], phi[0], 0.0]])
    return np.eye(3) + a * k + b * (k @ k)


@njit(cache=True)
def _normal(xyz, seen, r, t, baseline, offset, per, h, g):
    """Fills the normal equations; returns the robust cost."""
    h[:], g[:] = 0.0, 0.0
    j, e = np.zeros((3, 6)), np.zeros(3)
    cost = 0.0
    for n in range(len(xyz)):
        x = r[0, 0] * xyz[n, 0] + r[0, 1] * xyz[n, 1] + r[0, 2] * xyz[n, 2] + t[0]
        y = r[1, 0] * xyz[n, 0] + r[1, 1] * xyz[n, 1] + r[1, 2] * xyz[n, 2] + t[1]
        z = r[2, 0] * xyz[n, 0] + r[2, 1] * xyz[n, 1] + r[2, 2] * xyz[n, 2] + t[2]
        if z <= 1e-6:
            cost += np.log1p(1e6)
            continue
        iz = 1.0 / z
        x, y = x * iz, y * iz
        e[0], e[1], e[2] = x - seen[n, 0], y - seen[n, 1], 0.0
        rows = 2
        if not np.isnan(seen[n, 2]):
            rows, right = 3, x - baseline * iz
            e[2] = right + (1.0 + right * right) * offset - seen[n, 2]
            j[2, 0], j[2, 1], j[2, 2] = iz, 0.0, -right * iz
            j[2, 3], j[2, 4], j[2, 5] = -right * y, 1 + x * right, -y
        square = (e[0] * e[0] + e[1] * e[1] + e[2] * e[2]) * per
        cost += np.log1p(min(square, 1e6))
        w = per / (1.0 + square)
        j[0, 0], j[0, 2] = iz, -x * iz
        j[1, 1], j[1, 2] = iz, -y * iz
        j[0, 3], j[0, 4], j[0, 5] = -x * y, 1 + x * x, -y
        j[1, 3], j[1, 4], j[1, 5] = -1 - y * y, x * y, x
        for i in range(rows):
            for a in range(6):
                wa = w * j[i, a]
                g[a] += wa * e[i]
                for d in range(a, 6):
                    h[a, d] += wa * j[i, d]
    for a in range(6):
        for d in range(a):
            h[a, d] = h[d, a]
    return cost


@njit(cache=True)
def _refine(xyz, seen, rotation, translation, baseline, offset, scale, prior):
    r, t = rotation.copy(), translation.copy()
    h, g, since = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
    for i in range(12):
        wide = scale * max(1.0, 6.0 / (1 + i))
        _normal(xyz, seen, r, t, baseline, offset, 1.0 / (wide * wide), h, g)
        h += prior + 1e-9 * np.eye(6) * max(np.trace(h), 1e-12)
        step = -np.linalg.solve(h, g + prior @ since)
        turn = _exp(step[3:])
        r, t = turn @ r, turn @ t + step[:3]
        since += step
        if not np.isfinite(step).all():
            return rotation, translation, np.full(len(xyz), 1e9), h, False
        if i >= 6 and np.abs(step).max() < 1e-7:
            break
    _normal(xyz, seen, r, t, baseline, offset, 1.0 / (scale * scale), h, g)
    out = np.full(len(xyz), 1e9)
    for n in range(len(xyz)):
        p = r @ xyz[n] + t
        if p[2] > 1e-6:
            a, b, c = p[0] / p[2] - seen[n, 0], p[1] / p[2] - seen[n, 1], 0.0
            if not np.isnan(seen[n, 2]):
                right = (p[0] - baseline) / p[2]
                c = right + (1.0 + right * right) * offset - seen[n, 2]
            out[n] = np.sqrt(a * a + b * b + c * c)
    return r, t, out, h, True
