"""Localises a camera or a rectified pair by known points: motion-only bundle adjustment (sections 6.1, step 4, and
6.2).

The start is a predicted pose, or else the best pose of many minimal samples (RANSAC).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.kernels import kernel, part
from ispom.numerics.cholesky import factor, solve_factored
from ispom.numerics.reductions import median
from ispom.numerics.reprojection import add_by_twist, gradient_by_point, hessian_by_point, subtract_by_twists
from ispom.numerics.robust import robust_cost, weighted_information
from ispom.numerics.twist import moved
from ispom.numerics.vectors import matrix, plus, symmetric, times, vector
from ispom.solvers.epipolar import Rays

MAX_ITERATIONS = 30
"""Largest number of Gauss-Newton iterations of `fit_pose`; from a good start about eight are enough."""
MIN_POINTS = 6
"""Least number of inliers of a pose: twice the three points that fix it."""
MIN_INLIER_SHARE = 0.6
"""Least share of inliers of a pose from a prediction; with fewer, `locate` also tries RANSAC."""
MAX_SAMPLES = 1000
"""Largest number of samples of four points: with 30 % inliers, one of 850 samples has
inliers only, with a probability of 99.9 % (formula of Fischler and Bolles 1981)."""
MAX_OPTIMISED_SAMPLES = 2000
"""Largest number of samples of `resect_optimised`."""
PIXELS_PER_UNIT = 1000.0
"""Factor of normalised coordinates for OpenCV's USAC, which is written for thresholds of about a pixel."""


@dataclass(frozen=True, eq=False)
class PoseFit:
    """A pose, and how the points fit it."""

    camera_from_world: Pose
    distances: Array
    """(N,) reprojection errors over all images, normalised; 1e9 behind the camera."""
    inliers: NDArray[np.bool_]
    """(N,) distances within the threshold."""
    information: Array
    """(6, 6) information of the left twist (rho, phi), for observations with the loss scale as standard deviation."""


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
    """Returns camera_from_world from known points; None with fewer than 6 points within `threshold` at the end.

    Gauss-Newton from `guess` with the robust loss, whose width falls from the median error, at most `widest`, to
    `scale`. A small `widest` is for a good guess, as from a sample, where most points may be outliers.

    Args:
        xyz: (N, 3) points in the world.
        seen: (N, 2) normalised x, y, or (N, 3) x, y, right x of a perfect pair; the right x is NaN where unknown.
        prior: (6, 6) information of the guess, for what the points do not determine.
        rays: tracks of unknown depth, which contribute with half the weight of a point.
    """
    if len(xyz) < MIN_POINTS:
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
    for _ in range(MAX_ITERATIONS):
        # The loss is as wide as the remaining errors: all points have weight at a poor guess, only inliers in the end.
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
    if inliers.sum() < MIN_POINTS:
        return None
    return PoseFit(Pose(rotation[0], translation[0]), distances, inliers, blocks[0, 0] + held)


def _median(values: Array) -> float:
    """Returns the median, the upper one of an even number of values."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])


@dataclass(frozen=True)
class Policy:
    """The thresholds of `locate`, in normalised units."""

    width: float
    """Width of the robust loss."""
    limit: float
    """Largest reprojection error of an inlier."""
    sample_limit: float
    """Inlier threshold in RANSAC."""
    poor: float = np.inf
    """Median error of the inliers above which a pose from a prediction is poor, so that RANSAC is tried, too."""


def locate(
    xyz: Array, seen: Array, predicted: Pose, policy: Policy, baseline: float = 0.0, prior: Array | None = None
) -> PoseFit | None:
    """Returns the result of `fit_pose` from the prediction; if that is poor, the better of it and the pose by RANSAC.

    The better one has the lower robust cost, in which all outliers have the same cost. None if neither has a pose.
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
        return robust_cost(np.minimum(fit.distances, policy.limit) ** 2, policy.width)

    return min((fit for fit in (found, again) if fit is not None), key=cost, default=None)


def in_own_unit(xyz: Array, guess: Pose, fit: Callable[[Array, Pose], PoseFit | None]) -> PoseFit | None:
    """Returns the fit of points (N, 3) in the camera frame of `guess` (camera_from_world), in units of their median
    depth there. The result is in the world and unit of `xyz`.

    The damping of `fit_pose`, its nearest depth and the single precision of RANSAC suit depths of about 1. A map
    whose unit has shrunk to a millionth of that, as that of the published scale transfer does, needs this.
    """
    inside = guess.apply(xyz)
    unit = median(np.abs(inside[:, 2])) if len(inside) else 1.0
    if not 0 < unit < np.inf:
        return None
    found = fit(inside / unit, Pose())
    if found is None:
        return None
    near = found.camera_from_world
    scale = np.array([1 / unit] * 3 + [1.0] * 3)
    return replace(
        found,
        camera_from_world=Pose(near.rotation, unit * near.translation) @ guess,
        information=found.information * np.outer(scale, scale),
    )


def refine_pose(xyz: Array, x: Array, camera_from_world: Pose, threshold: float) -> PoseFit | None:
    """Returns `fit_pose` for points (N, 3) observed at (N, 2), with a loss half as wide as the inlier threshold."""
    return fit_pose(xyz, x, camera_from_world, threshold / 2, threshold)


def resect(xyz: Array, x: Array, threshold: float, samples: int = MAX_SAMPLES) -> PoseFit | None:
    """Returns the pose from points (N, 3) and normalised coordinates (N, 2): P3P in RANSAC, then `fit_pose`.

    `samples` is the largest number of samples; inliers are within `threshold`, normalised. None with fewer than 6
    inliers. Deterministic.
    """
    if len(xyz) < MIN_POINTS:
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
    if not found or index is None or len(index) < MIN_POINTS:
        return None
    best = _from_sample(xyz, x, rotvec, translation, threshold)
    if best is None or 2 * best.inliers.sum() < len(index):
        # OpenCV fits the inliers by EPnP, which may give the mirrored pose if they are on a plane.
        some = np.asarray(index, np.int64).ravel()
        try:
            found, rotvec, translation = cv2.solvePnP(xyz[some], x[some], np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP)
        except cv2.error:  # raised for points that nearly coincide
            return best
        best = _from_sample(xyz, x, rotvec, translation, threshold) if found else best
    return best


def resect_optimised(xyz: Array, x: Array, threshold: float) -> PoseFit | None:
    """Returns the result of `resect` with local optimisation (LO-RANSAC; Chum et al. 2003).

    The pose of each good sample is refined over its inliers. Without this, a sample of neighbouring points, or of
    points of uncertain depth, gives a pose that only its neighbours fit. It takes up to ten times as long.
    """
    if len(xyz) < MIN_POINTS:
        return None
    options = cv2.UsacParams()
    options.confidence, options.maxIterations, options.threshold = (
        0.999,
        MAX_OPTIMISED_SAMPLES,
        PIXELS_PER_UNIT * threshold,
    )
    options.score, options.sampler = cv2.SCORE_METHOD_MSAC, cv2.SAMPLING_UNIFORM
    options.loMethod, options.loIterations, options.loSampleSize = cv2.LOCAL_OPTIM_INNER_AND_ITER_LO, 10, 20
    options.isParallel, options.randomGeneratorState = False, 0
    found, _, rotvec, translation, index = cv2.solvePnPRansac(
        np.ascontiguousarray(xyz),
        np.ascontiguousarray(PIXELS_PER_UNIT * x),
        np.diag([PIXELS_PER_UNIT, PIXELS_PER_UNIT, 1.0]),
        None,
        params=options,
    )
    if not found or index is None or len(index) < MIN_POINTS:
        return None
    return _from_sample(xyz, x, rotvec, translation, threshold)


def _from_sample(xyz: Array, x: Array, rotvec: MatLike, translation: MatLike, threshold: float) -> PoseFit | None:
    """Returns `fit_pose` from the pose of a sample. The loss starts at half the threshold, so outliers have no
    weight."""
    guess = Pose.from_rotvec(np.asarray(rotvec, float), np.asarray(translation, float))
    return fit_pose(xyz, x, guess, threshold / 2, threshold, widest=threshold / 2)


@kernel()
def _stepped(r, t, h, g, held, pull, since):
    """Returns the pose after a Gauss-Newton step, and the largest components of its translation and rotation.

    `held` (6, 6) and `pull` (6,) are information and gradient of the guess and of rays. Adds the step to `since` (6,).
    Both components are inf if the equations are singular.
    """
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
    """Fills the normal equations (6, 6) and (6,), and the reprojection errors (N,)."""
    h[:], g[:] = 0.0, 0.0
    for n in range(len(xyz)):
        distances[n] = _add_point(n, xyz, seen, r, t, baseline, 1.0 / (scale * scale), h, g)
    h *= -1.0


@part
def _add_point(n, xyz, seen, r, t, baseline, per, h, g):
    """Adds point n to the gradient, and subtracts it from h; returns its reprojection error."""
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
