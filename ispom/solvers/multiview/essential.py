"""Estimates the relative pose of two views from point matches (section 6.1, step 2)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, skew, so3_exp
from ispom.numerics.robust import robust_weights


@dataclass(frozen=True, eq=False)
class RelativePose:
    """The relative pose of two views, and its inliers."""

    second_from_first: Pose
    """The relative pose; its translation has length 1."""
    inliers: NDArray[np.bool_]
    """(N,) whether a match fits the essential matrix and is in front of both cameras."""


def relative_pose(x1: Array, x2: Array, threshold: float, most_samples: int = 2000) -> RelativePose | None:
    """Estimates the relative pose from normalised coordinates (N, 2) in two views.

    Finds the five-point essential matrix in RANSAC with at most `most_samples` samples, checks cheirality, and refines.
    `threshold` is the inlier distance from the epipolar line in normalised units (pixels / focal length).
    None with fewer than 8 inliers or if no essential matrix is found. Deterministic.
    Nister 2004 (five-point), Barath et al. 2020 (OpenCV's MAGSAC++, see `inlier_distances`).
    """
    if len(x1) < 8:
        return None
    camera = np.diag([1 / threshold, 1 / threshold, 1.0])
    essential, mask = cv2.findEssentialMat(
        inlier_distances(x1, threshold), inlier_distances(x2, threshold), camera,
        method=cv2.USAC_MAGSAC, prob=0.9999, threshold=1.0, maxIters=most_samples,
    )  # fmt: skip
    if essential is None or essential.shape != (3, 3):
        return None
    count, rotation, translation, front = cv2.recoverPose(
        essential, x1, x2, np.eye(3), distanceThresh=1e6, mask=mask.copy()
    )[:4]
    inliers = front.ravel() > 0
    if count < 8:
        return None
    pose = refine_sampson(
        Pose(np.asarray(rotation, float), np.asarray(translation, float).ravel()), x1[inliers], x2[inliers], threshold
    )
    return RelativePose(pose, inliers)


def inlier_distances(x: Array, threshold: float) -> Array:
    """Returns normalised coordinates (N, 2) in units of the inlier distance, for OpenCV's MAGSAC++.

    MAGSAC++ has internal limits in pixels: with normalised coordinates and a threshold of 0.001 it loses most inliers
    of a homography, and some of an essential matrix.
    """
    return x / threshold


def sampson_distance(second_from_first: Pose, x1: Array, x2: Array) -> Array:
    """Returns signed Sampson distances (N,), in normalised units, from the epipolar geometry of a relative pose."""
    essential = skew(second_from_first.translation) @ second_from_first.rotation
    h1, h2 = _homogeneous(x1), _homogeneous(x2)
    line2, line1 = h1 @ essential.T, h2 @ essential
    scale = np.sqrt((line2[:, :2] ** 2).sum(1) + (line1[:, :2] ** 2).sum(1))
    return (h2 * line2).sum(1) / np.maximum(scale, 1e-12)


@dataclass(frozen=True, eq=False)
class Linearised:
    """Sampson distances near a relative pose, by its five degrees of freedom."""

    residuals: Array
    """(N,) in normalised units."""
    jacobian: Array
    """(N, 5) by a turn [rad] about the axes of the second view, and by steps of the direction along `tangent`."""
    tangent: Array
    """(2, 3) two directions at right angles to the translation."""


def linearised(second_from_first: Pose, x1: Array, x2: Array) -> Linearised:
    """Returns the Sampson distances of matches (N, 2) and their derivatives; the translation has length 1."""
    h1, h2 = _homogeneous(x1), _homogeneous(x2)
    t, rotation = second_from_first.translation, second_from_first.rotation
    tangent = np.linalg.svd(t[None])[2][1:]
    essential = skew(t) @ rotation
    line2, line1 = h1 @ essential.T, h2 @ essential
    norm = np.maximum(np.sqrt((line2[:, :2] ** 2).sum(1) + (line1[:, :2] ** 2).sum(1)), 1e-12)
    residual = (h2 * line2).sum(1) / norm
    # The derivative of the normalising term is second order at small residuals: neglected.
    x2r = h1 @ rotation.T
    by_rotation = np.cross(x2r, np.cross(h2, t))
    by_translation = np.cross(x2r, h2) @ tangent.T
    jacobian = np.concatenate([by_rotation, by_translation], axis=1) / norm[:, None]
    return Linearised(residual, jacobian, tangent)


def refine_sampson(pose: Pose, x1: Array, x2: Array, scale: float, iterations: int = 6) -> Pose:
    """Refines a relative pose, whose translation has length 1, by Gauss-Newton over its five degrees of freedom, with
    robust weights of this scale (normalised units)."""
    for _ in range(iterations):
        near = linearised(pose, x1, x2)
        residual, jacobian = near.residuals, near.jacobian
        weight = robust_weights(residual**2, scale)
        normal = jacobian.T @ (weight[:, None] * jacobian)
        delta = -np.linalg.solve(normal + 1e-12 * np.eye(5), jacobian.T @ (weight * residual))
        moved = pose.translation + delta[3:] @ near.tangent
        pose = Pose(so3_exp(delta[:3]) @ pose.rotation, moved / np.linalg.norm(moved))
        if np.abs(delta).max() < 1e-9:
            break
    return pose


def _homogeneous(x: Array) -> Array:
    return np.concatenate([x, np.ones((len(x), 1))], axis=1)
