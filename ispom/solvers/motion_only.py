"""Motion-only adjustment: the pose of one camera from scene points that are held, by robust reprojection error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ispom.geometry import Array, Pose


@dataclass(frozen=True, eq=False)
class Motion:
    camera_from_world: Pose
    residuals: Array
    """(N,) reprojection errors in normalised units; inf behind the camera."""
    inliers: NDArray[np.bool_]
    """(N,) residuals within the threshold."""
    information: Array
    """(6, 6) normal equations of the inliers by a left twist (rho, phi), per unit variance of a coordinate."""


def adjust_motion(
    xyz: Array, x: Array, camera_from_world: Pose, threshold: float, iterations: int = 10
) -> Motion | None:
    """Levenberg-Marquardt on the reprojection of points (N, 3) seen at normalised coordinates (N, 2), Cauchy loss.

    The loss starts wide and ends with the scale `threshold` / 2 (normalised units). None with fewer than 6 inliers
    at the end, or where the points do not determine the pose.
    """
    if len(xyz) < 6:
        return None
    rotation, translation, residuals, information = _adjust(
        np.ascontiguousarray(xyz, np.float64),
        np.ascontiguousarray(x, np.float64),
        np.array(camera_from_world.rotation, order="C"),
        np.array(camera_from_world.translation),
        threshold,
        iterations,
    )
    inliers = residuals <= threshold
    if inliers.sum() < 6 or not np.isfinite(translation).all():
        return None
    return Motion(Pose(rotation, translation), residuals, inliers, information)


@njit(cache=True)
def _cost(xyz, x, rotation, translation, scale):
    total = 0.0
    for k in range(len(xyz)):
        p = rotation @ xyz[k] + translation
        if p[2] <= 1e-6:
            total += np.log1p(1e6)
        else:
            du, dv = p[0] / p[2] - x[k, 0], p[1] / p[2] - x[k, 1]
            total += np.log1p(min((du * du + dv * dv) / (scale * scale), 1e6))
    return total


@njit(cache=True)
def _turn(phi):
    """The rotation matrix of a rotation vector (Rodrigues)."""
    angle = np.sqrt(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2])
    k = np.array([[0.0, -phi[2], phi[1]], [phi[2], 0.0, -phi[0]], [-phi[1], phi[0], 0.0]])
    if angle < 1e-6:
        return np.eye(3) + k + 0.5 * (k @ k)
    return np.eye(3) + np.sin(angle) / angle * k + (1 - np.cos(angle)) / (angle * angle) * (k @ k)


@njit(cache=True)
def _normal(xyz, x, rotation, translation, scale, hessian, gradient, cut):
    """Fills the normal equations; with `cut` > 0, those of residuals within it at weight 1."""
    hessian[:], gradient[:] = 0.0, 0.0
    j = np.zeros((2, 6))
    for k in range(len(xyz)):
        p = rotation @ xyz[k] + translation
        if p[2] <= 1e-6:
            continue
        iz = 1.0 / p[2]
        u, v = p[0] * iz, p[1] * iz
        r0, r1 = u - x[k, 0], v - x[k, 1]
        square = r0 * r0 + r1 * r1
        weight = 1.0 / (1.0 + square / (scale * scale))
        if cut > 0.0:
            weight = 1.0 if square <= cut * cut else 0.0
        j[0, 0], j[0, 2], j[1, 1], j[1, 2] = iz, -u * iz, iz, -v * iz
        j[0, 3], j[0, 4], j[0, 5] = -u * v, 1 + u * u, -v
        j[1, 3], j[1, 4], j[1, 5] = -1 - v * v, u * v, u
        for a in range(6):
            w0, w1 = weight * j[0, a], weight * j[1, a]
            gradient[a] += w0 * r0 + w1 * r1
            for b in range(a, 6):
                hessian[a, b] += w0 * j[0, b] + w1 * j[1, b]
    for a in range(6):
        for b in range(a):
            hessian[a, b] = hessian[b, a]


@njit(cache=True)
def _adjust(xyz, x, rotation, translation, threshold, iterations):
    hessian, gradient = np.zeros((6, 6)), np.zeros(6)
    damping = 1e-6
    for i in range(iterations):
        scale = threshold / 2 * max(1.0, 4.0 / (1 + i))
        _normal(xyz, x, rotation, translation, scale, hessian, gradient, 0.0)
        cost = _cost(xyz, x, rotation, translation, scale)
        done = True
        for _ in range(6):
            damped = hessian.copy()
            for a in range(6):
                damped[a, a] += damping * hessian[a, a] + 1e-12
            delta = -np.linalg.solve(damped, gradient)
            turn = _turn(delta[3:])
            new_rotation = turn @ rotation
            new_translation = turn @ translation + delta[:3]
            if _cost(xyz, x, new_rotation, new_translation, scale) <= cost:
                rotation, translation = new_rotation, new_translation
                damping = max(damping / 10, 1e-9)
                done = np.abs(delta).max() < 1e-7
                break
            damping *= 30
        if done and i >= 3:
            break
    residuals = np.empty(len(xyz))
    for k in range(len(xyz)):
        p = rotation @ xyz[k] + translation
        if p[2] <= 1e-6:
            residuals[k] = np.inf
        else:
            residuals[k] = np.sqrt((p[0] / p[2] - x[k, 0]) ** 2 + (p[1] / p[2] - x[k, 1]) ** 2)
    _normal(xyz, x, rotation, translation, threshold, hessian, gradient, threshold)
    return rotation, translation, residuals, hessian
