"""Local bundle adjustment: poses of a window of key frames and the points they see, by reprojection error.

Levenberg-Marquardt on normal equations reduced to the poses (Schur complement; Triggs et al. 2000), Cauchy loss
by iterated weights. The one hot loop is compiled; everything is sequential, so results repeat bit for bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, so3_exp


@dataclass(frozen=True, eq=False)
class Bundle:
    cameras_from_world: tuple[Pose, ...]
    xyz_in_world: Array
    """(M, 3)."""
    cost_before: float
    cost_after: float
    """Robust cost, in squares of the loss scale."""
    residuals: Array
    """(K,) reprojection errors, normalised units, after the adjustment."""


def adjust(
    cameras_from_world: tuple[Pose, ...],
    xyz_in_world: Array,
    camera_index: NDArray[np.int64],
    point_index: NDArray[np.int64],
    x: Array,
    fixed: int,
    scale: float,
    iterations: int = 10,
) -> Bundle:
    """Adjusts all cameras but the first `fixed` (two fix the gauge, scale included) and all points.

    Observation k (of K) is the normalised coordinates x[k] (2,) of point point_index[k] in camera camera_index[k];
    `scale` is that of the Cauchy loss in the same unit. Points behind a camera keep their weight at zero.
    """
    rotations = np.ascontiguousarray(np.stack([p.rotation for p in cameras_from_world]))
    translations = np.stack([p.translation for p in cameras_from_world])
    points, damping = np.array(xyz_in_world, float), 1e-4
    order = np.argsort(point_index, kind="stable")
    cameras, owners, seen = camera_index[order], point_index[order], np.ascontiguousarray(x[order])
    cost = before = _cost(rotations, translations, points, cameras, owners, seen, scale)
    for _ in range(iterations):
        pose_step, point_step = _solve(rotations, translations, points, cameras, owners, seen, fixed, scale, damping)
        turn = so3_exp(pose_step[:, 3:])
        new_rotations = np.ascontiguousarray(turn @ rotations)
        new_translations = (turn @ translations[:, :, None])[:, :, 0] + pose_step[:, :3]
        new_points = points + point_step
        new_cost = _cost(new_rotations, new_translations, new_points, cameras, owners, seen, scale)
        if not new_cost < cost:
            damping *= 10
            if damping > 1e6:
                break
            continue
        converged = cost - new_cost < 1e-5 * cost
        rotations, translations, points, cost = new_rotations, new_translations, new_points, new_cost
        damping = max(damping / 10, 1e-8)
        if converged:
            break
    residuals = np.empty(len(x))
    residuals[order] = _distances(rotations, translations, points, cameras, owners, seen)
    poses = tuple(Pose(r, t) for r, t in zip(rotations, translations, strict=True))
    return Bundle(poses, points, float(before), float(cost), residuals)


@njit(cache=True)
def _distances(rotations, translations, points, cameras, owners, seen):
    out = np.empty(len(cameras))
    for k in range(len(cameras)):
        p = rotations[cameras[k]] @ points[owners[k]] + translations[cameras[k]]
        if p[2] <= 1e-6:
            out[k] = np.inf
        else:
            out[k] = np.sqrt((p[0] / p[2] - seen[k, 0]) ** 2 + (p[1] / p[2] - seen[k, 1]) ** 2)
    return out


@njit(cache=True)
def _cost(rotations, translations, points, cameras, owners, seen, scale):
    total = 0.0
    distances = _distances(rotations, translations, points, cameras, owners, seen)
    for k in range(len(cameras)):
        # A point behind a camera costs what a gross error of 1000 scales does.
        total += np.log1p(min(distances[k] / scale, 1000.0) ** 2)
    return total


@njit(cache=True)
def _solve(rotations, translations, points, cameras, owners, seen, fixed, scale, damping):
    """One damped step: (C, 6) left twists (rho, phi) and (M, 3). Observations are sorted by point."""
    n_cameras, n_points, n_obs = len(rotations), len(points), len(cameras)
    size = 6 * (n_cameras - fixed)
    reduced, right = np.zeros((size, size)), np.zeros(size)
    inverses, sides = np.zeros((n_points, 3, 3)), np.zeros((n_points, 3))
    cross = np.zeros((n_obs, 6, 3))
    j_pose, j_point = np.zeros((2, 6)), np.zeros((2, 3))
    k = 0
    for m in range(n_points):
        begin = k
        v, b = np.zeros((3, 3)), np.zeros(3)
        while k < n_obs and owners[k] == m:
            c = cameras[k]
            p = rotations[c] @ points[m] + translations[c]
            if p[2] > 1e-6:
                iz = 1.0 / p[2]
                u, w = p[0] * iz, p[1] * iz
                r0, r1 = u - seen[k, 0], w - seen[k, 1]
                weight = 1.0 / (1.0 + (r0 * r0 + r1 * r1) / (scale * scale)) / (scale * scale)
                j_pose[0, 0], j_pose[0, 2] = iz, -u * iz
                j_pose[1, 1], j_pose[1, 2] = iz, -w * iz
                j_pose[0, 3], j_pose[0, 4], j_pose[0, 5] = -u * w, 1 + u * u, -w
                j_pose[1, 3], j_pose[1, 4], j_pose[1, 5] = -1 - w * w, u * w, u
                for a in range(3):
                    for i in range(2):
                        j_point[i, a] = (
                            j_pose[i, 0] * rotations[c, 0, a]
                            + j_pose[i, 1] * rotations[c, 1, a]
                            + j_pose[i, 2] * rotations[c, 2, a]
                        )
                for a in range(3):
                    b[a] -= weight * (j_point[0, a] * r0 + j_point[1, a] * r1)
                    for d in range(3):
                        v[a, d] += weight * (j_point[0, a] * j_point[0, d] + j_point[1, a] * j_point[1, d])
                if c >= fixed:
                    o = 6 * (c - fixed)
                    for a in range(6):
                        right[o + a] -= weight * (j_pose[0, a] * r0 + j_pose[1, a] * r1)
                        for d in range(6):
                            reduced[o + a, o + d] += weight * (
                                j_pose[0, a] * j_pose[0, d] + j_pose[1, a] * j_pose[1, d]
                            )
                        for d in range(3):
                            cross[k, a, d] = weight * (j_pose[0, a] * j_point[0, d] + j_pose[1, a] * j_point[1, d])
            k += 1
        for a in range(3):
            v[a, a] += damping * v[a, a] + 1e-9
        inverse = np.linalg.inv(v)
        inverses[m], sides[m] = inverse, b
        for first in range(begin, k):
            if cameras[first] < fixed:
                continue
            o = 6 * (cameras[first] - fixed)
            y = cross[first] @ inverse
            yb = y @ b
            for a in range(6):
                right[o + a] -= yb[a]
            for second in range(begin, k):
                if cameras[second] < fixed:
                    continue
                q = 6 * (cameras[second] - fixed)
                for a in range(6):
                    for d in range(6):
                        reduced[o + a, q + d] -= (
                            y[a, 0] * cross[second, d, 0]
                            + y[a, 1] * cross[second, d, 1]
                            + y[a, 2] * cross[second, d, 2]
                        )
    for a in range(size):
        reduced[a, a] += damping * abs(reduced[a, a]) + 1e-9
    pose_step = np.zeros((n_cameras, 6))
    solution = np.linalg.solve(reduced, right)
    for c in range(fixed, n_cameras):
        pose_step[c] = solution[6 * (c - fixed) : 6 * (c - fixed) + 6]
    point_step = np.zeros((n_points, 3))
    for k2 in range(n_obs):
        if cameras[k2] >= fixed:
            m = owners[k2]
            for d in range(3):
                for a in range(6):
                    sides[m, d] -= cross[k2, a, d] * pose_step[cameras[k2], a]
    for m in range(n_points):
        point_step[m] = inverses[m] @ sides[m]
    return pose_step, point_step
