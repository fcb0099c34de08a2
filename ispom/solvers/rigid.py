"""The rigid transformation between two corresponding point clouds (section 6.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """A rigid transformation of points, and its inliers."""

    target_from_source: Pose
    inliers: NDArray[np.bool_]
    """(N,) mask of the points."""


def horn(source: Array, target: Array) -> tuple[Array, Array]:
    """Returns the least-squares R (..., 3, 3), t (..., 3) with target ~ R source + t, of points (..., N, 3), N >= 3.

    Closed form without scale (Horn 1987; the SVD of Umeyama 1991, which never gives a reflection).
    """
    source_mean, target_mean = source.mean(-2, keepdims=True), target.mean(-2, keepdims=True)
    covariance = np.swapaxes(target - target_mean, -1, -2) @ (source - source_mean)
    u, _, vt = np.linalg.svd(covariance)
    u = u.copy()
    u[..., :, 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    rotation = u @ vt
    return rotation, target_mean[..., 0, :] - (rotation @ source_mean[..., 0, :, None])[..., 0]


def rigid_motion(
    source: Array, target: Array, tolerance: Array, hypotheses: int = 256, rounds: int = 5, seed: int = 0
) -> RigidMotion | None:
    """Finds target_from_source of points (N, 3) [m] with outliers: RANSAC over 3-point samples, then Horn on inliers.

    A point is an inlier if its error is within its own `tolerance` (N,) [m]: the depth error of stereo grows with the
    square of the distance. None with fewer than 6 inliers. Deterministic from `seed`.
    """
    n = len(source)
    if n < 6:
        return None
    rng = np.random.default_rng(seed)
    samples = rng.integers(0, n, (hypotheses, 3))
    rotation, translation = horn(source[samples], target[samples])
    error = np.linalg.norm(source @ np.swapaxes(rotation, 1, 2) + translation[:, None] - target, axis=2) / tolerance
    best = int(np.argmin(np.minimum(error, 1.0).sum(1)))
    inliers = error[best] <= 1
    for _ in range(rounds):
        if inliers.sum() < 6:
            return None
        r, t = horn(source[inliers], target[inliers])
        again = np.linalg.norm(source @ r.T + t - target, axis=1) <= tolerance
        if np.array_equal(again, inliers):
            break
        inliers = again
    return RigidMotion(Pose(r, t), inliers) if inliers.sum() >= 6 else None
