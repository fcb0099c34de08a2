"""Covariance of a camera's pose found by resection from points that are uncertain, and correlated, themselves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.kernels import kernel, part
from ispom.numerics.robust import Noise
from ispom.solvers.neighbours import by_group, cells, cluster_inflation
from ispom.solvers.spline.continuous import PointUncertainty
from ispom.solvers.spline.observation import (
    MIN_DEPTH,
    RIG,
    Observed,
    cauchy_weight,
    empty_rows,
    linearise,
    placed,
)
from ispom.solvers.spline.problem import AnchoredPoints

POSE = 6
"""Unknowns of a pose."""
BENDS = 2.0
"""Of the loss's own second derivatives, w J'J - 2 (w J'e) (w J'e)' / loss^2: where it is as narrow as the errors, poses
are off by more than with weights held."""


class Equations(NamedTuple):
    """Of a pose, by a twist (rho, phi) on its right, from K points."""

    information: Array
    """(6, 6)."""
    pull: Array
    """(6, n) how its right side follows the window."""
    slopes: Array
    """(K, 6) what each point says of it."""
    curvatures: Array
    """(K, 6, 6) of the information, the part of each point."""


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
    """(6, 6) of the twist (rho, phi) on the right of a pose found from points (K,) that were taken to be exact.

    Seen at (K, 2), weighed by `noise` and its loss (normalised units), and off as far as they turn out to be
    (`Solution.sandwich_covariance`), what is wrong with each point included. What all points
    follow is led back to the unknowns of their window, so that it is counted jointly; what a point says there and here
    is mostly one error, and is squared together. Errors with covariance `shared`
    (S, S) move the observations by `moved` (K, 2, S), and the points by uncertainty.shared.

    The sandwich H^-1 S H^-1 (Huber 1967; White 1982), as in `window.groups`: H has the loss's own second derivatives,
    S is by what points and groups of neighbours say (`neighbours.widened`).
    """
    n = uncertainty.sensitivity.shape[2]
    direct = np.zeros((len(seen), 2, n + uncertainty.shared.shape[2]))
    if moved is not None:
        direct[:, :, n:] = moved / noise.sigma
    observed = _observed(world_from_rig, rig_from_camera, points, seen, noise.sigma)
    follow = np.concatenate([uncertainty.sensitivity, uncertainty.shared], axis=2)
    equations = _equations(observed, noise.factor, BENDS, follow, direct)
    if not _is_minimum(equations.information):
        equations = _equations(observed, noise.factor, 0.0, follow, direct)
    information, pull = equations.information, equations.pull
    inverse = np.linalg.inv(information + 1e-9 * np.trace(information) * np.eye(POSE))
    turn, of_shared, of_rig = inverse @ pull[:, :n], inverse @ pull[:, n:], np.zeros((POSE, RIG))
    if of_video:
        # What is found is the camera; where the rig is depends on how the camera sits in it.
        r, t = rig_from_camera.rotation, rig_from_camera.translation
        of_rig[3:, :3], of_rig[:3, :3], of_rig[:3, 3:6] = r, np.cross(t, r.T).T, np.eye(3)
        turn[:, -RIG:] -= of_rig
    moves = uncertainty.moves @ turn.T
    # Slopes are those of the cost: the pose goes against them.
    alone, *groups = [
        by_group(int(of.max(initial=-1)) + 1, of, moves) - _without(of, equations, inverse) @ inverse
        for of in (np.arange(len(seen)), *_neighbours(seen))
    ]
    found = (
        turn @ uncertainty.parameters @ turn.T + cluster_inflation(alone, groups) * alone.T @ alone - moves.T @ moves
    )
    return found if shared is None else found + of_shared @ shared @ of_shared.T


def pose_information(
    world_from_rig: Pose, rig_from_camera: Pose, points: AnchoredPoints, seen: Array, noise: Noise
) -> Array:
    """(6, 6) of the twist (rho, phi) on the right of such a pose, relative to points that count as exact."""
    observed = _observed(world_from_rig, rig_from_camera, points, seen, noise.sigma)
    nothing = np.zeros((len(seen), 3, 0))
    return _equations(observed, noise.factor, 0.0, nothing, nothing[:, :2].copy()).information


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


def _is_minimum(information: Array) -> bool:
    try:
        np.linalg.cholesky(information)
    except np.linalg.LinAlgError:
        return False
    return True


def _neighbours(seen: Array) -> list[NDArray[np.int64]]:
    """Numbers (K,) of groups of neighbours, from 0 on."""
    return [np.unique(numbers, return_inverse=True)[1] for numbers in cells(seen)]


def _without(groups: NDArray[np.int64], equations: Equations, inverse: Array) -> Array:
    """(G, 6) what groups of points say, as if each had had no part in the estimate; `groups` (K,) from 0 on."""
    count = int(groups.max(initial=-1)) + 1
    said = by_group(count, groups, equations.slopes)
    own = by_group(count, groups, equations.curvatures.reshape(-1, POSE * POSE)).reshape(-1, POSE, POSE)
    return said + np.einsum("gij,gj->gi", own, said @ inverse)


@kernel()
def _equations(observed, loss, bends, follow, moved):
    """Points follow the window by `follow` (K, 3, n), observations by `moved` (K, 2, n) in standard deviations."""
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
            weight = cauchy_weight(rows, linearise(rows, observed, m, rig, camera), loss)
            for k in range(3):
                for i in range(2):
                    by_pose[k, i] = -observed.points[m, 2] * rows.by_rig[i, k]
                    by_pose[3 + k, i] = rows.by_pose[i, k]
            x, y = rows.errors[0], rows.errors[1]
            bent = bends * weight * weight / (loss * loss)
            second = weight - bent * x * x, -bent * x * y, weight - bent * y * y
            for k in range(POSE):
                found.slopes[m, k] = weight * (by_pose[k, 0] * x + by_pose[k, 1] * y)
            _add(found.information, found.curvatures[m], second, by_pose)
            _pull(found.pull, second, by_pose, rows.by_point, follow[m], moved[m])
    return found


@part
def _add(information, own, second, by_pose):
    """Adds what a point, by its own second derivatives (xx, xy, yy), says of the pose."""
    xx, xy, yy = second
    for k in range(POSE):
        a, b = xx * by_pose[k, 0] + xy * by_pose[k, 1], xy * by_pose[k, 0] + yy * by_pose[k, 1]
        for j in range(POSE):
            own[k, j] = a * by_pose[j, 0] + b * by_pose[j, 1]
            information[k, j] += own[k, j]


@part
def _pull(out, second, by_pose, by_point, follow, moved):
    """Subtracts from out (6, n) what pose and point (3, n) `follow` have to do with each other; adds the observation's
    own (2, n) `moved`."""
    xx, xy, yy = second
    for k in range(POSE):
        a, b = xx * by_pose[k, 0] + xy * by_pose[k, 1], xy * by_pose[k, 0] + yy * by_pose[k, 1]
        for i in range(out.shape[1]):
            out[k, i] += a * moved[0, i] + b * moved[1, i]
        for j in range(3):
            side = a * by_point[0, j] + b * by_point[1, j]
            for i in range(out.shape[1]):
                out[k, i] -= side * follow[j, i]
