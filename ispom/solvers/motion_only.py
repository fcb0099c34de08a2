"""Motion-only adjustment: the pose of a camera or a rectified pair from points that are held, by reprojection (6.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.kernels import kernel, part
from ispom.numerics.cholesky import factor, solve_factored
from ispom.numerics.reductions import median
from ispom.numerics.reprojection import add_by_twist, gradient_by_point, hessian_by_point, subtract_by_twists
from ispom.numerics.robust import weighted_information
from ispom.numerics.twist import moved
from ispom.numerics.vectors import matrix, plus, symmetric, times, vector
from ispom.solvers.epipolar import Rays

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
    rays: Rays | None = None,
) -> PoseFit | None:
    """camera_from_world from points (N, 3) seen at normalised x, y (N, 2), or by a pair at x, y, right x (N, 3).

    The right x is NaN where unknown, else that of a perfect pair. Gauss-Newton with Cauchy weights of `scale`, wider at
    first, at most `widest`: what agrees with a guess is that near, where it may be the lesser part. `prior` (6, 6):
    information of the guess itself, which holds what the points leave open. `rays` pull as well, with half a point's
    weight. None with fewer than 6 points within `threshold` at the end.
    """
    if len(xyz) < LEAST:
        return None
    if seen.shape[1] == 2:
        pair = np.full((len(seen), 3), np.nan)
        pair[:, :2] = seen
        seen = pair
    xyz, seen = np.ascontiguousarray(xyz, np.float64), np.ascontiguousarray(seen, np.float64)
    rotation, translation = np.array(guess.rotation[None], order="C"), np.array(guess.translation[None], order="C")
    guessed = np.zeros((6, 6)) if prior is None else np.ascontiguousarray(prior)
    held, since, pull = guessed, np.zeros(6), np.zeros(6)
    blocks, side, distances = np.empty((1, 1, 6, 6)), np.empty((1, 6)), np.empty(len(xyz))
    baseline, depth = float(baseline), median(np.abs(xyz @ guess.rotation[2] + guess.translation[2]))
    _normal(xyz, seen, rotation, translation, baseline, 1.0, blocks, side, distances)
    wide = max(scale, min(widest, _median(distances)))
    for _ in range(ITERATIONS):
        # As wide as the errors still are: from a poor guess all points pull, in the end only those that agree.
        _normal(xyz, seen, rotation, translation, baseline, wide, blocks, side, distances)
        if prior is not None:
            pull = prior @ since
        if rays is not None:
            squares, slope = rays.normal(Pose(rotation[0], translation[0]), wide)
            held, pull = guessed + squares, guessed @ since + slope
        rotation, translation, way, turn = _stepped(rotation, translation, blocks, side, held, pull, since)
        if way == np.inf:
            return None
        if wide == scale and turn < 0.01 * scale and way < 0.01 * scale * depth:
            break
        wide = max(scale, min(wide / 2, _median(distances))) if wide > 2 * scale else scale
    _normal(xyz, seen, rotation, translation, baseline, scale, blocks, side, distances)
    inliers = distances <= threshold
    if inliers.sum() < LEAST:
        return None
    return PoseFit(Pose(rotation[0], translation[0]), distances, inliers, blocks[0, 0] + held)


def _median(values: Array) -> float:
    """The upper one of an even number."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])


@kernel()
def _stepped(r, t, h, g, held, pull, since):
    """The pose after a step by these normal equations, with those of the guess and rays: information (6, 6), gradient
    (6,). Also the step's largest parts, way and turn: inf where there is no step. `since` (6,) grows by it."""
    damped, side, trace = np.empty((6, 6)), np.empty(6), 0.0
    for i in range(6):
        trace += h[0, 0, i, i]
        side[i] = g[0, i] + pull[i]
        for j in range(6):
            damped[i, j] = h[0, 0, i, j] + held[i, j]
    for i in range(6):
        damped[i, i] += 1e-9 * max(trace, 1e-12)
    step = solve_factored(factor(damped), side)
    way, turn, total = 0.0, 0.0, 0.0
    for i in range(6):
        step[i] = -step[i]
        since[i] += step[i]
        total += abs(step[i])
        if i < 3:
            way = max(way, abs(step[i]))
        else:
            turn = max(turn, abs(step[i]))
    if not total < np.inf:
        return r, t, np.inf, np.inf
    after, there = moved(r, t, step.reshape(1, 6))
    return after, there, way, turn


@kernel()
def _normal(xyz, seen, r, t, baseline, scale, h, g, distances):
    """Fills the normal equations (6, 6) and (6,), and the distances (N,) of the points from where they were seen."""
    h[:], g[:] = 0.0, 0.0
    for n in range(len(xyz)):
        distances[n] = _add_point(n, xyz, seen, r, t, baseline, 1.0 / (scale * scale), h, g)
    h *= -1.0


@part
def _add_point(n, xyz, seen, r, t, baseline, per, h, g):
    """Adds point n to the gradient and subtracts it from h; its distance."""
    q = plus(times(matrix(r, 0), vector(xyz, n)), vector(t, 0))
    if q[2] <= 1e-6:
        return 1e9
    iz, paired = 1.0 / q[2], seen[n, 2] == seen[n, 2]
    x, y = q[0] * iz, q[1] * iz
    right = x - baseline * iz if paired else 0.0
    ex, ey, er = x - seen[n, 0], y - seen[n, 1], right - seen[n, 2] if paired else 0.0
    square = ex * ex + ey * ey + er * er
    weighted = weighted_information(square, per) * iz
    hessian = hessian_by_point(x, y, right, weighted * iz, 1.0, 0.0, 1.0, 1.0 if paired else 0.0)
    add_by_twist(g, 0, q, gradient_by_point(x, y, right, weighted, ex, ey, er))
    subtract_by_twists(h, 0, 0, q, symmetric(hessian), q)
    return np.sqrt(square)
