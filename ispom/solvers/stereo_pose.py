"""Motion-only pose of one camera or a rectified pair: reprojection in both images, robust (modern form of 6.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, so3_exp

ITERATIONS = 30
"""At most; about eight are needed from a good guess."""


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
    held, since, pose = np.zeros((6, 6)) if prior is None else prior, np.zeros(6), guess
    information, gradient, distances = np.zeros((6, 6)), np.zeros(6), np.empty(len(xyz))
    depth = float(np.median(np.abs(guess.apply(xyz)[:, 2])))

    def normal(wide: float) -> None:
        _normal(xyz, seen, pose.rotation, pose.translation, baseline, offset, wide, information, gradient, distances)

    normal(1.0)
    wide = max(scale, float(np.median(distances)))
    for _ in range(ITERATIONS):
        # As wide as the errors still are: from a poor guess all points pull, in the end only those that agree.
        normal(wide)
        damped = information + held + 1e-9 * max(float(np.trace(information)), 1e-12) * np.eye(6)
        step = -np.linalg.solve(damped, gradient + held @ since)
        if not np.isfinite(step).all():
            return None
        turn = so3_exp(step[3:])
        pose, since = Pose(turn @ pose.rotation, turn @ pose.translation + step[:3]), since + step
        still = np.abs(step[3:]).max() < 0.01 * scale and np.abs(step[:3]).max() < 0.01 * scale * depth
        if still and wide == scale:
            break
        wide = max(scale, min(wide / 2, float(np.median(distances))))
    normal(scale)
    inliers = distances <= threshold
    return Located(pose, distances, inliers, information + held) if inliers.sum() >= 6 else None


@njit(cache=True)
def _normal(xyz, seen, r, t, baseline, offset, scale, h, g, distances):
    """Fills the normal equations, and the distances (N,) of the points from where they were seen."""
    h[:], g[:] = 0.0, 0.0
    j, e, per = np.zeros((3, 6)), np.zeros(3), 1.0 / (scale * scale)
    for n in range(len(xyz)):
        x = r[0, 0] * xyz[n, 0] + r[0, 1] * xyz[n, 1] + r[0, 2] * xyz[n, 2] + t[0]
        y = r[1, 0] * xyz[n, 0] + r[1, 1] * xyz[n, 1] + r[1, 2] * xyz[n, 2] + t[1]
        z = r[2, 0] * xyz[n, 0] + r[2, 1] * xyz[n, 1] + r[2, 2] * xyz[n, 2] + t[2]
        if z <= 1e-6:
            distances[n] = 1e9
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
        square = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
        distances[n] = np.sqrt(square)
        w = per / (1.0 + square * per)
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
