"""Covariance of a camera's pose found by resection from points that are uncertain, and correlated, themselves."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array, Pose
from ispom.kernels import kernel
from ispom.solvers.continuous import AnchoredPoints, PointUncertainty
from ispom.solvers.normal_equations import MIN_DEPTH, RIG, into_camera


def pose_covariance(
    world_from_rig: Pose,
    rig_from_camera: Pose,
    of_video: bool,
    points: AnchoredPoints,
    seen: Array,
    sigma: float,
    loss: float,
    uncertainty: PointUncertainty,
) -> Array:
    """(6, 6) of the twist (rho, phi) on the right of a pose found from points (K,) that were taken to be exact.

    Seen at (K, 2), with errors `sigma` and a Cauchy loss of scale `loss` times that (normalised units). What the
    points' errors do to the pose is followed back to the unknowns of their window, so that it is counted jointly.
    """
    information, noise, pull = _equations(
        world_from_rig.rotation,
        world_from_rig.translation,
        rig_from_camera.rotation,
        rig_from_camera.translation,
        points.anchors_r,
        points.anchors_t,
        points.values,
        np.ascontiguousarray(seen),
        sigma,
        loss,
        uncertainty.sensitivity,
        uncertainty.conditional,
    )
    inverse = np.linalg.inv(information + 1e-9 * np.trace(information) * np.eye(6))
    turn, of_rig = inverse @ pull, np.zeros((6, RIG))
    if of_video:
        # What is found is the camera; where the rig is depends on how the camera sits in it.
        r, t = rig_from_camera.rotation, rig_from_camera.translation
        of_rig[3:, :3], of_rig[:3, :3], of_rig[:3, 3:6] = r, np.cross(t, r.T).T, np.eye(3)
        turn[:, -RIG:] -= of_rig
    return inverse @ noise @ inverse + turn @ uncertainty.parameters @ turn.T


def pose_information(
    world_from_rig: Pose, rig_from_camera: Pose, points: AnchoredPoints, seen: Array, sigma: float, loss: float
) -> Array:
    """(6, 6) of the twist (rho, phi) on the right of such a pose, relative to points that count as exact."""
    none = np.zeros((len(seen), 3, 3))
    return _equations(
        world_from_rig.rotation,
        world_from_rig.translation,
        rig_from_camera.rotation,
        rig_from_camera.translation,
        points.anchors_r,
        points.anchors_t,
        points.values,
        np.ascontiguousarray(seen),
        sigma,
        loss,
        none[:, :, :0].copy(),
        none,
    )[0]


@kernel()
def _equations(r, p, camera_r, camera_t, anchors_r, anchors_t, values, seen, sigma, loss, rows, own):
    """Information (6, 6) of the pose, the noise (6, 6) in its right side, and how that follows the window (6, n)."""
    n = rows.shape[2]
    information, noise, pull = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, n))
    d, y, x, row = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    jp, jl = np.empty((2, 6)), np.empty((2, 3))
    for m in range(len(values)):
        into_camera(r, p, camera_r, camera_t, anchors_r[m], anchors_t[m], values[m], d, y, x)
        if x[2] <= MIN_DEPTH:
            continue
        iz, rho = 1.0 / x[2], values[m, 2]
        u, v = x[0] * iz, x[1] * iz
        e0, e1 = (u - seen[m, 0]) / sigma, (v - seen[m, 1]) / sigma
        weight = 1.0 / (1.0 + (e0 * e0 + e1 * e1) / (loss * loss))
        for i in range(2):
            s, a = iz / sigma, u if i == 0 else v
            for k in range(3):
                row[k] = s * (camera_r[k, i] - a * camera_r[k, 2])
            world = r @ row
            for k in range(3):
                jp[i, k] = -rho * row[k]
                jl[i, k] = 0.0
            jp[i, 3] = row[1] * y[2] - row[2] * y[1]
            jp[i, 4] = row[2] * y[0] - row[0] * y[2]
            jp[i, 5] = row[0] * y[1] - row[1] * y[0]
            for k in range(3):
                jl[i, 0] += world[k] * anchors_r[m, k, 0]
                jl[i, 1] += world[k] * anchors_r[m, k, 1]
                jl[i, 2] += world[k] * (anchors_t[m, k] - p[k]) - row[k] * camera_t[k]
        doubt = jl @ own[m] @ jl.T
        doubt[0, 0] += 1.0
        doubt[1, 1] += 1.0
        information += weight * (jp.T @ jp)
        noise += weight * weight * (jp.T @ doubt @ jp)
        side = weight * (jp.T @ jl)
        for k in range(6):
            for j in range(3):
                f = side[k, j]
                for i in range(n):
                    pull[k, i] -= f * rows[m, j, i]
    return information, noise, pull
