"""Covariance of a camera's pose found by resection from points that are uncertain, and correlated, themselves."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array, Pose
from ispom.kernels import kernel, part
from ispom.solvers.spline.continuous import PointUncertainty
from ispom.solvers.spline.observation import (
    MIN_DEPTH,
    RIG,
    Observed,
    cauchy_weight,
    empty_rows,
    linearise,
    placed,
    slope,
)
from ispom.solvers.spline.problem import AnchoredPoints

POSE = 6
"""Unknowns of a pose."""


def pose_covariance(
    world_from_rig: Pose,
    rig_from_camera: Pose,
    of_video: bool,
    points: AnchoredPoints,
    seen: Array,
    sigma: float,
    loss: float,
    uncertainty: PointUncertainty,
    moved: Array | None = None,
    shared: Array | None = None,
) -> Array:
    """(6, 6) of the twist (rho, phi) on the right of a pose found from points (K,) that were taken to be exact.

    Seen at (K, 2), weighed by errors `sigma` and a Cauchy loss of scale `loss` times that (normalised units), and off
    as far as they turn out to be (`Solution.as_far_off`), what is wrong with each point included. What all points
    follow is led back to the unknowns of their window, so that it is counted jointly. Errors with covariance `shared`
    (S, S) move the observations by `moved` (K, 2, S), and the points by uncertainty.shared.
    """
    n = uncertainty.sensitivity.shape[2]
    direct = np.zeros((len(seen), 2, n + uncertainty.shared.shape[2]))
    if moved is not None:
        direct[:, :, n:] = moved / sigma
    information, noise, pull, weights = _equations(
        _observed(world_from_rig, rig_from_camera, points, seen, sigma),
        loss,
        np.concatenate([uncertainty.sensitivity, uncertainty.shared], axis=2),
        direct,
    )
    # Six of the errors' degrees of freedom went into the pose.
    noise /= slope(weights, 2) ** 2 * (1 - POSE / (2 * len(seen)))
    inverse = np.linalg.inv(information + 1e-9 * np.trace(information) * np.eye(6))
    turn, of_shared, of_rig = inverse @ pull[:, :n], inverse @ pull[:, n:], np.zeros((6, RIG))
    if of_video:
        # What is found is the camera; where the rig is depends on how the camera sits in it.
        r, t = rig_from_camera.rotation, rig_from_camera.translation
        of_rig[3:, :3], of_rig[:3, :3], of_rig[:3, 3:6] = r, np.cross(t, r.T).T, np.eye(3)
        turn[:, -RIG:] -= of_rig
    found = inverse @ noise @ inverse + turn @ uncertainty.parameters @ turn.T
    return found if shared is None else found + of_shared @ shared @ of_shared.T


def pose_information(
    world_from_rig: Pose, rig_from_camera: Pose, points: AnchoredPoints, seen: Array, sigma: float, loss: float
) -> Array:
    """(6, 6) of the twist (rho, phi) on the right of such a pose, relative to points that count as exact."""
    observed, nothing = _observed(world_from_rig, rig_from_camera, points, seen, sigma), np.zeros((len(seen), 3, 0))
    return _equations(observed, loss, nothing, nothing[:, :2].copy())[0]


def _observed(
    world_from_rig: Pose, rig_from_camera: Pose, points: AnchoredPoints, seen: Array, sigma: float
) -> Observed:
    """One exposure of one camera, which sees each point once."""
    count = len(seen)
    none, per = np.zeros(count, np.int64), np.tile([1 / sigma, 1 / sigma, 0.0], (count, 1))
    return Observed.of(
        world_from_rig.rotation[None],
        world_from_rig.translation[None],
        rig_from_camera.rotation[None],
        rig_from_camera.translation[None],
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


@kernel()
def _equations(observed, loss, follow, moved):
    """Information (6, 6) of the pose, the noise (6, 6) in its right side, how that follows the window (6, n); weights.

    Points follow the window by `follow` (K, 3, n), observations by `moved` (K, 2, n) in standard deviations.
    """
    information, noise, pull = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, follow.shape[2]))
    rows, by_pose, weights = empty_rows(), np.empty((6, 2)), np.zeros(len(follow))
    for m in range(len(follow)):
        rig, camera = placed(observed, m)
        if camera[2] > MIN_DEPTH:
            weights[m] = weight = cauchy_weight(rows, linearise(rows, observed, m, rig, camera), loss)
            for k in range(3):
                for i in range(2):
                    by_pose[k, i] = -observed.points[m, 2] * rows.by_rig[i, k]
                    by_pose[3 + k, i] = rows.by_pose[i, k]
            _add(information, noise, weight, by_pose, rows.errors)
            _pull(pull, weight, by_pose, rows.by_point, follow[m], moved[m])
    return information, noise, pull, weights


@part
def _add(information, noise, weight, by_pose, errors):
    """Adds a point that is seen with such errors."""
    for k in range(6):
        a, b = weight * by_pose[k, 0], weight * by_pose[k, 1]
        pull = weight * (a * errors[0] + b * errors[1])
        for j in range(6):
            information[k, j] += a * by_pose[j, 0] + b * by_pose[j, 1]
            noise[k, j] += pull * (by_pose[j, 0] * errors[0] + by_pose[j, 1] * errors[1])


@part
def _pull(out, weight, by_pose, by_point, follow, moved):
    """Subtracts from out (6, n) what pose and point (3, n) `follow` have to do with each other; adds the observation's
    own (2, n) `moved`."""
    for k in range(6):
        first, second = weight * by_pose[k, 0], weight * by_pose[k, 1]
        for i in range(out.shape[1]):
            out[k, i] += first * moved[0, i] + second * moved[1, i]
        for j in range(3):
            side = first * by_point[0, j] + second * by_point[1, j]
            for i in range(out.shape[1]):
                out[k, i] -= side * follow[j, i]
