"""Resection: the pose of a camera from scene points and their images (section 6.1, step 4)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, so3_exp
from ispom.numerics.reprojection import reprojected
from ispom.numerics.robust import cauchy_weights

SAMPLES = 1000
"""Of four points, at most: where 30 % of the points agree with the pose, 850 of them hold such a sample at 99.9 %."""
OPTIMISED_SAMPLES = 2000
"""The same where each that is good is optimised."""
UNIT = 1000.0
"""Of image coordinates for OpenCV's newer samplers, which take thresholds to be of the size of pixels."""


@dataclass(frozen=True, eq=False)
class Resection:
    camera_from_world: Pose
    residuals: Array
    """(N,) reprojection errors in normalised units; inf behind the camera."""
    inliers: NDArray[np.bool_]
    """(N,) residuals within the threshold."""


def resect(
    xyz: Array, x: Array, threshold: float, scale: float | None = None, samples: int = SAMPLES
) -> Resection | None:
    """Pose from points (N, 3) and normalised coordinates (N, 2): P3P in RANSAC, then robust refinement. Deterministic.

    `samples` at most. `threshold`, and the loss's scale as in `refine_pose`, in normalised units. None with fewer than
    6 inliers.
    """
    if len(xyz) < 6:
        return None
    cv2.setRNGSeed(0)
    found, rvec, tvec, index = cv2.solvePnPRansac(
        xyz,
        x,
        np.eye(3),
        None,
        iterationsCount=samples,
        reprojectionError=threshold,
        confidence=0.999,
        flags=cv2.SOLVEPNP_AP3P,
    )
    if not found or index is None or len(index) < 6:
        return None
    found = _refined(xyz, x, rvec, tvec, threshold, scale)
    if found is None or 2 * found.inliers.sum() < len(index):
        # OpenCV poses its inliers by EPnP, which of a plane may give the mirrored pose.
        some = np.asarray(index, np.int64).ravel()
        try:
            solved, rvec, tvec = cv2.solvePnP(xyz[some], x[some], np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP)
        except cv2.error:  # it refuses points that all but coincide
            return found
        found = _refined(xyz, x, rvec, tvec, threshold, scale) if solved else found
    return found


def resect_optimised(xyz: Array, x: Array, threshold: float) -> Resection | None:
    """The same with each good sample optimised over what agrees with it (Chum et al. 2003): a sample of points that lie
    close together, or whose depth is not well known, else finds a pose that only its neighbours agree with.

    It takes up to ten times as long.
    """
    if len(xyz) < 6:
        return None
    found, _, rvec, tvec, index = cv2.solvePnPRansac(
        np.ascontiguousarray(xyz),
        np.ascontiguousarray(UNIT * x),
        np.diag([UNIT, UNIT, 1.0]),
        None,
        params=_optimising(UNIT * threshold),
    )
    if not found or index is None or len(index) < 6:
        return None
    # What does not agree would pull at the wide loss that refinement begins with.
    some = np.asarray(index, np.int64).ravel()
    best = _refined(xyz[some], x[some], rvec, tvec, threshold, None)
    return None if best is None else _judged(xyz, x, best.camera_from_world, threshold)


def _optimising(threshold: float) -> cv2.UsacParams:
    found = cv2.UsacParams()
    found.confidence, found.maxIterations, found.threshold = 0.999, OPTIMISED_SAMPLES, threshold
    found.score, found.sampler = cv2.SCORE_METHOD_MSAC, cv2.SAMPLING_UNIFORM
    found.loMethod, found.loIterations, found.loSampleSize = cv2.LOCAL_OPTIM_INNER_AND_ITER_LO, 10, 20
    found.isParallel, found.randomGeneratorState = False, 0
    return found


def _refined(
    xyz: Array, x: Array, rvec: MatLike, tvec: MatLike, threshold: float, scale: float | None
) -> Resection | None:
    guess = Pose.from_rotvec(np.asarray(rvec, float), np.asarray(tvec, float))
    return refine_pose(xyz, x, guess, threshold, scale=scale)


def refine_pose(
    xyz: Array,
    x: Array,
    camera_from_world: Pose,
    threshold: float,
    iterations: int = 10,
    scale: float | None = None,
) -> Resection | None:
    """Motion-only adjustment of a good first guess: Gauss-Newton on reprojection with Cauchy weights.

    Starts with a wide loss and ends with one of `scale`, or `threshold` / 2. None with fewer than 6 inliers at the
    end, or where the points do not determine the pose.
    """
    least = threshold / 2 if scale is None else scale
    pose = camera_from_world
    for i in range(iterations):
        loss = max(least, 2 * threshold / (1 + i) if scale is None else 2 * threshold / 2**i)
        residual, jacobian, front = _reprojection(xyz, x, pose)
        if front.sum() < 6:
            return None
        weight = np.repeat(cauchy_weights((residual**2).sum(1), loss), 2)
        j, r = jacobian.reshape(-1, 6), residual.ravel()
        normal = j.T @ (weight[:, None] * j)
        try:
            delta = -np.linalg.solve(normal, j.T @ (weight * r))
        except np.linalg.LinAlgError:
            return None
        if not np.abs(delta).max() < 1e6:
            return None
        turn = so3_exp(delta[3:])
        pose = Pose(turn @ pose.rotation, turn @ pose.translation + delta[:3])
        if i >= 4 and np.abs(delta).max() < 1e-8:
            break
    return _judged(xyz, x, pose, threshold)


def _judged(xyz: Array, x: Array, pose: Pose, threshold: float) -> Resection | None:
    """None with fewer than 6 inliers."""
    residual, _, front = _reprojection(xyz, x, pose)
    distance = np.full(len(xyz), np.inf)
    distance[front] = np.linalg.norm(residual, axis=1)
    inliers = distance <= threshold
    return Resection(pose, distance, inliers) if inliers.sum() >= 6 else None


def _reprojection(xyz: Array, x: Array, pose: Pose) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Residuals (K, 2) and Jacobians (K, 2, 6) by a left twist (rho, phi), of the points in front (mask (N,))."""
    p = pose.apply(xyz)
    front = p[:, 2] > 1e-6
    uv, _, by_twist = reprojected(p[front])
    return uv - x[front], by_twist, front
