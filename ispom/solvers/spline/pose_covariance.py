"""Covariance of a camera's pose found by resection from points that are uncertain, and correlated, themselves."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array, Pose
from ispom.kernels import kernel, part
from ispom.solvers.spline.continuous import PointUncertainty
from ispom.solvers.spline.observation import MIN_DEPTH, RIG, Observed, cauchy_weight, empty_rows, linearise, placed
from ispom.solvers.spline.problem import AnchoredPoints


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
        _observed(world_from_rig, rig_from_camera, points, seen, sigma),
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
        _observed(world_from_rig, rig_from_camera, points, seen, sigma), loss, none[:, :, :0].copy(), none
    )[0]


def _observed(
    world_from_rig: Pose, rig_from_camera: Pose, points: AnchoredPoints, seen: Array, sigma: float
) -> Observed:
    """One exposure of one camera, which sees each point once."""
    count = len(seen)
    none, per = np.zeros(count, np.int64), np.tile([1 / sigma, 1 / sigma, 0.0], (count, 1))
    return Observed(
        np.ascontiguousarray(world_from_rig.rotation)[None],
        np.ascontiguousarray(world_from_rig.translation)[None],
        np.ascontiguousarray(rig_from_camera.rotation)[None],
        np.ascontiguousarray(rig_from_camera.translation)[None],
        0.0,
        none,
        none,
        np.arange(count),
        np.column_stack([seen, np.zeros(count)]),
        per,
        points.anchors_r,
        points.anchors_t,
        points.values,
    )


@kernel(error_model="numpy")
def _equations(observed, loss, follow, own):
    """Information (6, 6) of the pose, the noise (6, 6) in its right side, and how that follows the window (6, n).

    Points follow the window by `follow` (K, 3, n), and have covariances `own` (K, 3, 3) beside.
    """
    information, noise, pull = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, follow.shape[2]))
    rows, by_pose = empty_rows(), np.empty((2, 6))
    for m in range(len(own)):
        rig, camera = placed(observed, m)
        if camera[2] <= MIN_DEPTH:
            continue
        weight = cauchy_weight(rows, linearise(rows, observed, m, rig, camera), loss)
        by_pose[:, :3] = -observed.points[m, 2] * rows.by_rig[:2]
        by_pose[:, 3:] = rows.by_pose[:2, :3]
        by_point = rows.by_point[:2]
        doubt = by_point @ own[m] @ by_point.T
        doubt[0, 0] += 1.0
        doubt[1, 1] += 1.0
        information += weight * (by_pose.T @ by_pose)
        noise += weight * weight * (by_pose.T @ doubt @ by_pose)
        _pull(pull, weight * (by_pose.T @ by_point), follow[m])
    return information, noise, pull


@part
def _pull(out, side, follow):
    """Subtracts side (6, 3) times follow (3, n) from out (6, n)."""
    for k in range(6):
        for j in range(3):
            for i in range(out.shape[1]):
                out[k, i] -= side[k, j] * follow[j, i]
