"""Covariance of a camera's pose that was resected from uncertain, correlated points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.kernels import kernel, part
from ispom.numerics.robust import Noise
from ispom.solvers.spline.continuous import PointUncertainty
from ispom.solvers.spline.observation import (
    MIN_DEPTH,
    RIG,
    Observed,
    empty_rows,
    linearise,
    placed,
    robust_weight,
)
from ispom.solvers.spline.problem import AnchoredPoints
from ispom.solvers.window.covariance import cells, cluster_inflation, inverse_curvature, sum_by_group
from ispom.solvers.window.kernels import FIXED_WEIGHTS, OWN_CURVATURE

POSE = 6
"""Number of unknowns of a pose."""


class Equations(NamedTuple):
    """Derivatives of a pose's cost by a twist (rho, phi) on its right, from K points, with the loss's own curvature."""

    fixed: Array
    """(6, 6) second derivatives with fixed weights."""
    by_unknowns: Array
    """(6, n) negative derivative of the gradient by the unknowns that move the points and observations."""
    scores: Array
    """(K, 6) gradient of each point."""
    curvatures: Array
    """(K, 6, 6) second derivatives of each point."""


def pose_covariance(
    world_from_rig: Pose,
    rig_from_camera: Pose,
    of_video: bool,
    points: AnchoredPoints,
    seen: Array,
    noise: Noise,
    uncertainty: PointUncertainty,
    moved: Array | None = None,
    shared: Array | None = None,
) -> Array:
    """Returns the covariance (6, 6), right twist (rho, phi), of a pose resected from uncertain points (K,).

    Args:
        seen: (K, 2) observations, normalised; weighted by `noise` and its loss.
        uncertainty: of the points. Their common errors are those of a window's unknowns. The error of a track in the
            window and here is mostly the same one, so both are added before they are squared.
        moved: (K, 2, S) Jacobian of the observations by further errors; that of the points is uncertainty.shared.
        shared: (S, S) covariance of these errors.

    It is the sandwich of `window.covariance`: own curvature, scores as if left out, clusters, small sample.
    """
    n = uncertainty.sensitivity.shape[2]
    direct = np.zeros((len(seen), 2, n + uncertainty.shared.shape[2]))
    if moved is not None:
        direct[:, :, n:] = moved / noise.sigma
    observed = _observed(world_from_rig, rig_from_camera, points, seen, noise.sigma)
    follow = np.concatenate([uncertainty.sensitivity, uncertainty.shared], axis=2)
    equations = _equations(observed, noise.factor, OWN_CURVATURE, follow, direct)
    inverse = inverse_curvature(equations.curvatures.sum(axis=0), equations.fixed)
    by_unknowns = inverse @ equations.by_unknowns
    by_window, by_shared, of_rig = by_unknowns[:, :n], by_unknowns[:, n:], np.zeros((POSE, RIG))
    if of_video:
        # The resection estimates the camera's pose; the rig's depends on the camera's pose in the rig, too.
        r, t = rig_from_camera.rotation, rig_from_camera.translation
        of_rig[3:, :3], of_rig[:3, :3], of_rig[:3, 3:6] = r, np.cross(t, r.T).T, np.eye(3)
        by_window[:, -RIG:] -= of_rig
    moves = uncertainty.moves @ by_window.T
    # Scores are gradients of the cost: the pose moves against them.
    alone, *grouped = [
        sum_by_group(int(of.max(initial=-1)) + 1, of, moves) - _left_out(of, equations, inverse) @ inverse
        for of in (np.arange(len(seen)), *_neighbours(seen))
    ]
    window = by_window @ uncertainty.parameters @ by_window.T - moves.T @ moves
    found = window + cluster_inflation(alone, grouped) * alone.T @ alone
    return found if shared is None else found + by_shared @ shared @ by_shared.T


def pose_information(
    world_from_rig: Pose, rig_from_camera: Pose, points: AnchoredPoints, seen: Array, noise: Noise
) -> Array:
    """Returns the information (6, 6) on such a pose, right twist (rho, phi), from exact points, with fixed weights."""
    observed = _observed(world_from_rig, rig_from_camera, points, seen, noise.sigma)
    nothing = np.zeros((len(seen), 3, 0))
    return _equations(observed, noise.factor, FIXED_WEIGHTS, nothing, nothing[:, :2].copy()).fixed


def _observed(
    world_from_rig: Pose, rig_from_camera: Pose, points: AnchoredPoints, seen: Array, sigma: float
) -> Observed:
    """Returns the observations of one frame of one camera, one of each point."""
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


def _neighbours(seen: Array) -> list[NDArray[np.int64]]:
    """Returns the group (K,) of each observation, from 0 on, for each grouping."""
    return [np.unique(numbers, return_inverse=True)[1] for numbers in cells(seen)]


def _left_out(groups: NDArray[np.int64], equations: Equations, inverse: Array) -> Array:
    """Returns the scores (G, 6) of `groups` (K,) of points, from 0 on, as if each had not contributed to the pose."""
    count = int(groups.max(initial=-1)) + 1
    scores = sum_by_group(count, groups, equations.scores)
    own = sum_by_group(count, groups, equations.curvatures.reshape(-1, POSE * POSE)).reshape(-1, POSE, POSE)
    return scores + np.einsum("gij,gj->gi", own, scores @ inverse)


@kernel()
def _equations(observed, loss, second_order, follow, moved):
    """Computes the `Equations`. `follow` (K, 3, n) are the derivatives of the points by the unknowns, `moved` (K, 2, n)
    those of the observations, in standard deviations; `second_order` is as in window.kernels.reduce_points."""
    count = len(follow)
    found = Equations(
        np.zeros((POSE, POSE)),
        np.zeros((POSE, follow.shape[2])),
        np.zeros((count, POSE)),
        np.zeros((count, POSE, POSE)),
    )
    rows, by_pose = empty_rows(), np.empty((POSE, 2))
    for m in range(count):
        rig, camera = placed(observed, m)
        if camera[2] > MIN_DEPTH:
            weight = robust_weight(rows, linearise(rows, observed, m, rig, camera), loss)
            for k in range(3):
                for i in range(2):
                    by_pose[k, i] = -observed.points[m, 2] * rows.by_rig[i, k]
                    by_pose[3 + k, i] = rows.by_pose[i, k]
            x, y = rows.errors[0], rows.errors[1]
            term = second_order * weight * weight / (loss * loss)
            second = weight - term * x * x, -term * x * y, weight - term * y * y
            for k in range(POSE):
                found.scores[m, k] = weight * (by_pose[k, 0] * x + by_pose[k, 1] * y)
            _add_curvature(found.fixed, found.curvatures[m], weight, second, by_pose)
            _add_by_unknowns(found.by_unknowns, second, by_pose, rows.by_point, follow[m], moved[m])
    return found


@part
def _add_curvature(fixed, own, weight, second, by_pose):
    """Fills a point's second derivatives by the pose, from those `second` (xx, xy, yy) by its errors; adds those with
    fixed weights."""
    xx, xy, yy = second
    for k in range(POSE):
        x, y = by_pose[k, 0], by_pose[k, 1]
        a, b = xx * x + xy * y, xy * x + yy * y
        for j in range(POSE):
            own[k, j] = a * by_pose[j, 0] + b * by_pose[j, 1]
            fixed[k, j] += weight * (x * by_pose[j, 0] + y * by_pose[j, 1])


@part
def _add_by_unknowns(out, second, by_pose, by_point, follow, moved):
    """Adds a point's derivatives to `out` (6, n): those by its own changes `follow` (3, n) are subtracted, those by the
    changes `moved` (2, n) of its observation added."""
    xx, xy, yy = second
    for k in range(POSE):
        a, b = xx * by_pose[k, 0] + xy * by_pose[k, 1], xy * by_pose[k, 0] + yy * by_pose[k, 1]
        for i in range(out.shape[1]):
            out[k, i] += a * moved[0, i] + b * moved[1, i]
        for j in range(3):
            side = a * by_point[0, j] + b * by_point[1, j]
            for i in range(out.shape[1]):
                out[k, i] -= side * follow[j, i]
