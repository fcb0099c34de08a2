"""Keyframes, points and their one lens (focal length, principal point, k1, k2): cost and normal equations.

Points are homogeneous (Triggs et al. 2000, section 2.3), so that those at infinity, which separate rotations from the
focal length, are as good as any other. Cauchy loss; the points are eliminated by their Schur complement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, skew
from ispom.numerics.robust import cauchy_weights

LENS, POSE = 5, 6
"""Unknowns of the lens: logarithm of the focal length, principal point [px], k1, k2; and of a pose."""
Scale = float | Array
"""Width of the loss [px]: of all observations, or (K,) of each."""
BEHIND = 1e6
"""Squared error in scales of a point behind its camera."""
MIN_DEPTH = 1e-9
HELD = 1e15


@dataclass(frozen=True, eq=False)
class Prior:
    """Prior of the lens."""

    mean: Array
    """(5,)."""
    sigma: Array
    """(5,) 0 fixes a value."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Values to be adjusted; views and points are numbered as the observations have them."""

    lens: Array
    """(5,) log f, cx, cy, k1, k2."""
    rotations: Array
    """(V, 3, 3) camera_from_world and"""
    translations: Array
    """(V, 3)."""
    points: Array
    """(M, 4) homogeneous, of length 1."""


@dataclass(frozen=True, eq=False)
class Observed:
    """Observations."""

    view: NDArray[np.int64]
    """(K,)."""
    point: NDArray[np.int64]
    """(K,)."""
    uv: Array
    """(K, 2) [px]."""

    def select(self, keep: NDArray) -> Observed:
        """Selects observations by a boolean mask or index array."""
        return Observed(self.view[keep], self.point[keep], self.uv[keep])


@dataclass(frozen=True, eq=False)
class Fixed:
    """The parameters that are not adjusted."""

    views: NDArray[np.bool_]
    """(V,) poses that stay."""
    points: bool = False
    """All points are fixed."""


def cost(scene: Scene, seen: Observed, prior: Prior, scale_px: Scale) -> float:
    """Half the robust sum of squares, with the prior's part."""
    squares = np.minimum((errors_px(scene, seen) / scale_px) ** 2, BEHIND)
    free = prior.sigma > 0
    away = (scene.lens - prior.mean)[free] / prior.sigma[free]
    return 0.5 * float(np.log1p(squares).sum()) + 0.5 * float(away @ away)


def errors_px(scene: Scene, seen: Observed) -> Array:
    """Returns distances (K,) of predicted from observed positions; large behind a camera."""
    q = in_camera(scene, seen)
    ahead = q[:, 2] > MIN_DEPTH
    uv = projected(scene.lens, np.where(ahead[:, None], q, [0, 0, 1.0]))
    return np.where(ahead, np.linalg.norm(uv - seen.uv, axis=1), 1e9)


def in_camera(scene: Scene, seen: Observed) -> Array:
    """Returns points (K, 3) in their cameras, up to scale."""
    x = scene.points[seen.point]
    turned = (scene.rotations[seen.view] @ x[:, :3, None])[..., 0]
    return turned + x[:, 3:] * scene.translations[seen.view]


def projected(lens: Array, q: Array) -> Array:
    """Pixels (K, 2) of points (K, 3) before the camera."""
    x = q[:, :2] / q[:, 2:]
    r2 = (x * x).sum(1, keepdims=True)
    return np.exp(lens[0]) * x * (1 + r2 * (lens[3] + r2 * lens[4])) + lens[1:3]


def undistorted(lens: Array, uv: Array, rounds: int = 20) -> Array:
    """Returns positions (K, 2) on the plane z = 1 of pixels (K, 2), by fixed-point iteration."""
    bent = (uv - lens[1:3]) / np.exp(lens[0])
    x = bent
    for _ in range(rounds):
        r2 = (x * x).sum(1, keepdims=True)
        x = bent / np.maximum(1 + r2 * (lens[3] + r2 * lens[4]), 0.3)
    return x


@dataclass(frozen=True, eq=False)
class Jacobian:
    """Derivatives of the residuals in loss widths, each row multiplied with the root of its weight."""

    by_lens: Array
    """(K, 2, 5) by the lens."""
    by_pose: Array
    """(K, 2, 6) by the observation's view, as left twists."""
    by_point: Array
    """(K, 2, 3) by its point, along the tangents."""
    root: Array
    """(K, 1) factor of a residual [px]; 0 behind a camera."""

    def gradient(self, residual: Array, seen: Observed, views: int, points: int) -> tuple[Array, Array]:
        """(P,) and (M, 3) that weighted residuals (K, 2) have by lens and poses, and by the points."""
        by_lens = self.by_lens.reshape(-1, LENS).T @ residual.ravel()
        by_pose = _summed((self.by_pose * residual[..., None]).sum(1), seen.view, views)
        by_point = _summed((self.by_point * residual[..., None]).sum(1), seen.point, points)
        return np.concatenate([by_lens, by_pose.ravel()]), by_point


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations of lens and poses (P = 5 + 6 V), the points eliminated."""

    matrix: Array
    """(P, P)."""
    gradient: Array
    """(P,)."""
    mixed: Array
    """(M, 3, P) blocks with the points,"""
    inverse: Array
    """(M, 3, 3) their own blocks,"""
    by_point: Array
    """(M, 3) their gradients,"""
    tangents: Array
    """(M, 4, 3) and the directions of their steps."""
    fixed: NDArray[np.int64]
    """Which of lens and poses are fixed."""
    jacobian: Jacobian
    scores: Array
    """(M, P) each point's part of the gradient of lens and poses; empty unless requested."""


def normal_equations(
    scene: Scene, seen: Observed, prior: Prior, fixed: Fixed, scale_px: Scale, damping: float, scored: bool = False
) -> Normal:
    """Computes the equations at a scene, in loss widths."""
    views, count = len(scene.rotations), len(scene.points)
    size = LENS + POSE * views
    q = in_camera(scene, seen)
    ahead = q[:, 2] > MIN_DEPTH
    q = np.where(ahead[:, None], q, [0, 0, 1.0])
    residual, by_q, by_lens = _linearised(scene.lens, q, seen.uv)
    square = (residual * residual).sum(1) / scale_px**2
    root = (np.sqrt(np.where(ahead, cauchy_weights(square, 1.0), 0.0)) / scale_px)[:, None]
    residual, by_q, by_lens = root * residual, root[..., None] * by_q, root[..., None] * by_lens
    tangents = _tangents(scene.points)
    x = scene.points[seen.point]
    # q = R x_3 + t w: a left twist moves it by w rho + phi x q
    by_pose = np.concatenate([by_q * x[:, 3, None, None], -by_q @ skew(q)], axis=2)
    moves = np.concatenate([scene.rotations[seen.view], scene.translations[seen.view][..., None]], axis=2)
    by_point = by_q @ (moves @ tangents[seen.point])

    jacobian = Jacobian(by_lens, by_pose, by_point, root)
    matrix = np.zeros((size, size))
    gradient, point_gradient = jacobian.gradient(residual, seen, views, count)
    flat = by_lens.reshape(-1, LENS)
    matrix[:LENS, :LENS] = flat.T @ flat
    lens_pose = _summed(np.swapaxes(by_lens, 1, 2) @ by_pose, seen.view, views)
    pose_pose = _summed(np.swapaxes(by_pose, 1, 2) @ by_pose, seen.view, views)
    for v in range(views):
        here = slice(LENS + POSE * v, LENS + POSE * (v + 1))
        matrix[:LENS, here], matrix[here, :LENS], matrix[here, here] = lens_pose[v], lens_pose[v].T, pose_pose[v]
    own = _summed(np.swapaxes(by_point, 1, 2) @ by_point, seen.point, count)
    mixed = np.zeros((count, 3, size))
    mixed[:, :, :LENS] = _summed(np.swapaxes(by_point, 1, 2) @ by_lens, seen.point, count)
    columns = LENS + POSE * seen.view[:, None] + np.arange(POSE)
    rows = seen.point[:, None, None], np.arange(3)[:, None], columns[:, None]
    mixed[rows] = np.swapaxes(by_point, 1, 2) @ by_pose
    scores = np.zeros((count if scored else 0, size))
    if scored:
        scores[:, :LENS] = _summed((by_lens * residual[..., None]).sum(1), seen.point, count)
        scores[seen.point[:, None], columns] = (by_pose * residual[..., None]).sum(1)

    free = prior.sigma > 0
    index = np.flatnonzero(free)
    matrix[index, index] += prior.sigma[free] ** -2
    gradient[index] += (scene.lens - prior.mean)[free] / prior.sigma[free] ** 2
    fixed_index = np.concatenate([np.flatnonzero(~free), LENS + np.flatnonzero(np.repeat(fixed.views, POSE))])
    matrix[fixed_index, fixed_index] += HELD
    gradient[fixed_index] = 0.0
    block = own * (1 + damping * np.eye(3)) + 1e-12 * np.eye(3)
    inverse = np.zeros_like(block) if fixed.points else np.linalg.inv(block)
    return Normal(
        matrix=matrix,
        gradient=gradient,
        mixed=mixed,
        inverse=inverse,
        by_point=point_gradient,
        tangents=tangents,
        fixed=fixed_index,
        jacobian=jacobian,
        scores=scores,
    )


def reduced(normal: Normal) -> tuple[Array, Array]:
    """(P, P) and (P,) without the points."""
    if not normal.inverse.any():  # points that stay
        return normal.matrix, normal.gradient
    root = np.swapaxes(np.linalg.cholesky(normal.inverse), 1, 2)
    half = (root @ normal.mixed).reshape(-1, normal.mixed.shape[2])  # half.T @ half: a symmetric product, half the work
    return normal.matrix - half.T @ half, normal.gradient - (root @ normal.by_point[..., None]).ravel() @ half


def _linearised(lens: Array, q: Array, uv: Array) -> tuple[Array, Array, Array]:
    """Residuals (K, 2), and their change by the point in its camera (K, 2, 3) and by the lens (K, 2, 5)."""
    focal, z = np.exp(lens[0]), q[:, 2]
    x = q[:, :2] / z[:, None]
    r2 = (x * x).sum(1)
    bend, slope = 1 + r2 * (lens[3] + r2 * lens[4]), lens[3] + 2 * lens[4] * r2
    by_x = focal * (bend[:, None, None] * np.eye(2) + 2 * slope[:, None, None] * x[:, :, None] * x[:, None])
    by_q = np.concatenate([by_x, -by_x @ x[..., None]], axis=2) / z[:, None, None]
    by_lens = np.zeros((len(q), 2, LENS))
    by_lens[:, :, 0] = focal * bend[:, None] * x
    by_lens[:, 0, 1] = by_lens[:, 1, 2] = 1.0
    by_lens[:, :, 3], by_lens[:, :, 4] = focal * r2[:, None] * x, focal * (r2**2)[:, None] * x
    return focal * bend[:, None] * x + lens[1:3] - uv, by_q, by_lens


def _tangents(points: Array) -> Array:
    """Returns bases (M, 4, 3) orthonormal to unit vectors (M, 4): the Householder reflection that maps them to the
    last axis."""
    sign = np.where(points[:, 3] < 0, -1.0, 1.0)
    normal = points.copy()
    normal[:, 3] += sign
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return (np.eye(4) - 2 * normal[:, :, None] * normal[:, None])[:, :, :3]


def _summed(values: Array, owner: NDArray[np.int64], count: int) -> Array:
    """(count, ...) sums of values (K, ...) by owner."""
    flat = values.reshape(len(values), -1)
    out = np.stack([np.bincount(owner, column, count) for column in flat.T], axis=1)
    return out.reshape(count, *values.shape[1:]).astype(float)
