"""Motion-only adjustment: the pose of a camera or a rectified pair from points that are held, by reprojection (6.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.kernels import kernel
from ispom.solvers.cholesky import factor, solve_factored
from ispom.solvers.twist import moved

ITERATIONS = 30
"""At most; about eight are needed from a good guess."""
LEAST = 6
"""Points that a pose needs."""


@dataclass(frozen=True, eq=False)
class PoseFit:
    camera_from_world: Pose
    distances: Array
    """(N,) reprojection errors over all images, normalised; 1e9 behind the camera."""
    inliers: NDArray[np.bool_]
    """(N,) distances within the threshold."""
    information: Array
    """(6, 6) of the left twist (rho, phi), the loss's scale taken as the standard deviation."""


def fit_pose(
    xyz: Array,
    seen: Array,
    guess: Pose,
    scale: float,
    threshold: float,
    baseline: float = 0.0,
    prior: Array | None = None,
    widest: float = np.inf,
) -> PoseFit | None:
    """camera_from_world from points (N, 3) seen at normalised x, y (N, 2), or by a pair at x, y, right x (N, 3).

    The right x is NaN where unknown, else that of a perfect pair. Gauss-Newton with Cauchy weights of `scale`, wider at
    first, at most `widest`: what agrees with a guess is that near, where it may be the lesser part. `prior` (6, 6):
    information of the guess itself, which holds what the points leave open. None with fewer than 6 points within
    `threshold` at the end.
    """
    if len(xyz) < LEAST:
        return None
    if seen.shape[1] == 2:
        seen = np.column_stack([seen, np.full(len(seen), np.nan)])
    xyz, seen = np.ascontiguousarray(xyz, np.float64), np.ascontiguousarray(seen, np.float64)
    rotation, translation = np.array(guess.rotation[None], order="C"), np.array(guess.translation[None], order="C")
    held, since = np.zeros((6, 6)) if prior is None else prior, np.zeros(6)
    information, gradient, distances = np.empty((6, 6)), np.empty(6), np.empty(len(xyz))
    depth = float(np.median(np.abs(guess.apply(xyz)[:, 2])))

    def normal(wide: float) -> None:
        pose = rotation[0], translation[0]
        _normal(xyz, seen, *pose, float(baseline), wide, information, gradient, distances)

    normal(1.0)
    wide = max(scale, min(widest, _median(distances)))
    for _ in range(ITERATIONS):
        # As wide as the errors still are: from a poor guess all points pull, in the end only those that agree.
        normal(wide)
        damped = information + held
        damped.flat[::7] += 1e-9 * max(float(information.trace()), 1e-12)
        step = -solve_factored(factor(damped), gradient + held @ since)
        if not np.isfinite(step).all():
            return None
        rotation, translation = moved(rotation, translation, step[None])
        since += step
        size = np.abs(step)
        still = size[3:].max() < 0.01 * scale and size[:3].max() < 0.01 * scale * depth
        if still and wide == scale:
            break
        wide = max(scale, min(wide / 2, _median(distances)))
    normal(scale)
    inliers = distances <= threshold
    if inliers.sum() < LEAST:
        return None
    return PoseFit(Pose(rotation[0], translation[0]), distances, inliers, information + held)


def _median(values: Array) -> float:
    """The upper one of an even number."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])


@kernel(error_model="numpy")
def _normal(xyz, seen, r, t, baseline, scale, h, g, distances):
    """Fills the normal equations, and the distances (N,) of the points from where they were seen."""
    per = 1.0 / (scale * scale)
    for a in range(6):
        g[a] = 0.0
        for b in range(6):
            h[a, b] = 0.0
    for n in range(len(xyz)):
        q0 = r[0, 0] * xyz[n, 0] + r[0, 1] * xyz[n, 1] + r[0, 2] * xyz[n, 2] + t[0]
        q1 = r[1, 0] * xyz[n, 0] + r[1, 1] * xyz[n, 1] + r[1, 2] * xyz[n, 2] + t[1]
        q2 = r[2, 0] * xyz[n, 0] + r[2, 1] * xyz[n, 1] + r[2, 2] * xyz[n, 2] + t[2]
        if q2 <= 1e-6:
            distances[n] = 1e9
            continue
        iz, f, right, er = 1.0 / q2, 0.0, 0.0, 0.0
        x, y = q0 * iz, q1 * iz
        ex, ey = x - seen[n, 0], y - seen[n, 1]
        if seen[n, 2] == seen[n, 2]:
            f, right = 1.0, x - baseline * iz
            er = right - seen[n, 2]
        square = ex * ex + ey * ey + er * er
        distances[n] = np.sqrt(square)
        # By the point in the camera: x and y have (1, 0, -x) / z and (0, 1, -y) / z, right x has (1, 0, -right) / z.
        wz = per / (1.0 + square * per) * iz
        ww = wz * iz
        k00, k02, k22 = ww * (1.0 + f), -ww * (x + f * right), ww * (x * x + y * y + f * right * right)
        k11, k12 = ww, -ww * y
        g0, g1, g2 = wz * (ex + er), wz * ey, -wz * (x * ex + y * ey + right * er)
        g[0] += g0
        g[1] += g1
        g[2] += g2
        g[3] += q1 * g2 - q2 * g1
        g[4] += q2 * g0 - q0 * g2
        g[5] += q0 * g1 - q1 * g0
        # A left twist moves that point by B = [I | -[q]x] times it: B' K B, column by column.
        for a0, a1, a2, a in (
            (k00, 0.0, k02, 0),
            (0.0, k11, k12, 1),
            (k02, k12, k22, 2),
            (q1 * k02, q1 * k12 - q2 * k11, q1 * k22 - q2 * k12, 3),
            (q2 * k00 - q0 * k02, -q0 * k12, q2 * k02 - q0 * k22, 4),
            (-q1 * k00, q0 * k11, q0 * k12 - q1 * k02, 5),
        ):
            h[0, a] += a0
            h[1, a] += a1
            h[2, a] += a2
            h[3, a] += q1 * a2 - q2 * a1
            h[4, a] += q2 * a0 - q0 * a2
            h[5, a] += q0 * a1 - q1 * a0
