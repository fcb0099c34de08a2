"""The pose of a camera or a rectified pair from known points: motion-only adjustment (sections 6.1, step 4, and 6.2)
from a predicted pose, else from the best of many small samples (RANSAC)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.kernels import kernel, part
from ispom.numerics.cholesky import factor, solve_factored
from ispom.numerics.reductions import median
from ispom.numerics.reprojection import add_by_twist, gradient_by_point, hessian_by_point, subtract_by_twists
from ispom.numerics.robust import cauchy_cost, weighted_information
from ispom.numerics.twist import moved
from ispom.numerics.vectors import matrix, plus, symmetric, times, vector
from ispom.solvers.epipolar import Rays

ITERATIONS = 30
"""At most; about eight are needed from a good guess."""
LEAST = 6
"""Points that a pose needs."""
MIN_INLIER_SHARE = 0.6
"""A pose found from a prediction that fewer of its points agree with is sought again from samples."""
SAMPLES = 1000
"""Of four points, at most: where 30 % of the points agree with the pose, 850 of them hold such a sample at 99.9 %."""
OPTIMISED_SAMPLES = 2000
"""The same where each good sample is optimised."""
UNIT = 1000.0
"""Of image coordinates for OpenCV's newer samplers, which take thresholds to be of the size of pixels."""


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


@dataclass(frozen=True)
class Policy:
    """When a pose counts as found. All in normalised units."""

    width: float
    """Of the robust loss."""
    limit: float
    """Largest reprojection error of an inlier."""
    sample_limit: float
    """The same for a pose from samples."""
    poor: float = np.inf
    """A pose whose inliers have a larger median error is sought again from samples, too."""


def locate(
    xyz: Array, seen: Array, predicted: Pose, policy: Policy, baseline: float = 0.0, prior: Array | None = None
) -> PoseFit | None:
    """Returns camera_from_world as `fit_pose` does from the prediction; where that is poor, the better one of it and
    the pose from samples, by the robust cost in which all outliers count the same.
    """
    args = policy.width, policy.limit, baseline, prior
    found = fit_pose(xyz, seen, predicted, *args)
    enough = found is not None and found.inliers.mean() >= MIN_INLIER_SHARE
    if found is not None and enough and not median(found.distances[found.inliers]) > policy.poor:
        return found
    sampled = resect(xyz, seen[:, :2], policy.sample_limit)
    if sampled is None:
        return found
    again = fit_pose(xyz, seen, sampled.camera_from_world, *args, widest=policy.sample_limit)

    def cost(fit: PoseFit) -> float:
        return cauchy_cost(np.minimum(fit.distances, policy.limit) ** 2, policy.width)

    return min((fit for fit in (found, again) if fit is not None), key=cost, default=None)


def refine_pose(xyz: Array, x: Array, camera_from_world: Pose, threshold: float) -> PoseFit | None:
    """Returns `fit_pose` of points (N, 3) seen at (N, 2), with a loss half as wide as the inlier threshold."""
    return fit_pose(xyz, x, camera_from_world, threshold / 2, threshold)


def resect(xyz: Array, x: Array, threshold: float, samples: int = SAMPLES) -> PoseFit | None:
    """Returns the pose from points (N, 3) and normalised coordinates (N, 2): P3P in RANSAC, then `fit_pose`.

    At most so many `samples`; inliers are within `threshold`, normalised. None with fewer than 6. Deterministic.
    """
    if len(xyz) < LEAST:
        return None
    cv2.setRNGSeed(0)
    found, rotvec, translation, index = cv2.solvePnPRansac(
        xyz,
        x,
        np.eye(3),
        None,
        iterationsCount=samples,
        reprojectionError=threshold,
        confidence=0.999,
        flags=cv2.SOLVEPNP_AP3P,
    )
    if not found or index is None or len(index) < LEAST:
        return None
    best = _from_sample(xyz, x, rotvec, translation, threshold)
    if best is None or 2 * best.inliers.sum() < len(index):
        # OpenCV poses its inliers by EPnP, which of a plane may give the mirrored pose.
        some = np.asarray(index, np.int64).ravel()
        try:
            found, rotvec, translation = cv2.solvePnP(xyz[some], x[some], np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP)
        except cv2.error:  # it refuses points that all but coincide
            return best
        best = _from_sample(xyz, x, rotvec, translation, threshold) if found else best
    return best


def resect_optimised(xyz: Array, x: Array, threshold: float) -> PoseFit | None:
    """Returns the same with each good sample optimised over what agrees with it (Chum et al. 2003): a sample of points
    that lie close together, or whose depth is not well known, else finds a pose that only its neighbours agree with.

    It takes up to ten times as long.
    """
    if len(xyz) < LEAST:
        return None
    options = cv2.UsacParams()
    options.confidence, options.maxIterations, options.threshold = 0.999, OPTIMISED_SAMPLES, UNIT * threshold
    options.score, options.sampler = cv2.SCORE_METHOD_MSAC, cv2.SAMPLING_UNIFORM
    options.loMethod, options.loIterations, options.loSampleSize = cv2.LOCAL_OPTIM_INNER_AND_ITER_LO, 10, 20
    options.isParallel, options.randomGeneratorState = False, 0
    found, _, rotvec, translation, index = cv2.solvePnPRansac(
        np.ascontiguousarray(xyz),
        np.ascontiguousarray(UNIT * x),
        np.diag([UNIT, UNIT, 1.0]),
        None,
        params=options,
    )
    if not found or index is None or len(index) < LEAST:
        return None
    return _from_sample(xyz, x, rotvec, translation, threshold)


def _from_sample(xyz: Array, x: Array, rotvec: MatLike, translation: MatLike, threshold: float) -> PoseFit | None:
    """Outliers have little weight from the start: half of the threshold is the widest loss."""
    guess = Pose.from_rotvec(np.asarray(rotvec, float), np.asarray(translation, float))
    return fit_pose(xyz, x, guess, threshold / 2, threshold, widest=threshold / 2)


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
