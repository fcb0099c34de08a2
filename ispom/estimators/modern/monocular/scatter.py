"""What the covariance of a window is made of: how its cost curves, and how far its gradient scatters.

A sandwich (Huber 1967; White 1982): an estimate is off by H^-1 g, so its covariance is H^-1 S H^-1, with S the
covariance of the gradient g where the truth is. The normal equations alone take all errors to be independent and of one
size, and hold the loss's weights: they take some directions for sure by half as much again as they are. For what
says most of how far a camera went are the nearest points, and just these have the largest errors. So H has the loss's
own second derivatives, and S is the sum of what each track says by itself: whatever its errors are, and however they
hang together from view to view, they are in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.numerics.reprojection import reprojected
from ispom.solvers.window.adjustment import Equations, Window
from ispom.solvers.window.observation import MIN_DEPTH
from ispom.solvers.window.prior import LENS, POSE, Sandwich

LEAST_SHARE = 0.1
"""Of the curvature with weights held: a point that keeps less says nothing of poses, and no direction keeps less."""


@dataclass(frozen=True, eq=False)
class Curvature:
    """Derivatives of the cost of a window's observations, D = 6 C + 2: by left twists of poses, and by corrections."""

    window: Window
    design: Array
    """(K, 2, 8) of each error, by the pose that it has and by the corrections."""
    by_point: Array
    """(K, 2, 3)."""
    weight: Array
    """(K,) that the loss gives."""
    reduced: Array
    """(D, D) second ones, the points eliminated."""
    scores: Array
    """(M, D) first ones, of each point by itself, the point eliminated."""
    conditional: Array
    """(M, 3, 3) inverse of the second ones by each point, weights held."""
    mixed: Array
    """(M, 3, D) by each point, and by poses and corrections, weights held."""

    @staticmethod
    def of(window: Window, sigma: float) -> Curvature:
        """`sigma`: width of the loss, normalised."""
        turns = window.rotations[window.cameras]
        near = (turns @ window.points[window.owners][:, :, None])[..., 0] + window.translations[window.cameras]
        front = near[:, 2] > MIN_DEPTH
        near[:, 2] = np.where(front, near[:, 2], 1.0)
        uv, by_place, by_pose = reprojected(near)
        square = (uv**2).sum(axis=1, keepdims=True)
        error = (1 + window.extra[0] + window.extra[1] * square) * uv - window.seen[:, :2]
        weight = front / (sigma**2 + (error**2).sum(axis=1))
        design, by_point = np.concatenate([by_pose, np.stack([uv, uv * square], axis=2)], axis=2), by_place @ turns
        held = weight[:, None, None] * np.swapaxes(by_point, 1, 2)
        pulled = (held @ error[:, :, None])[..., 0]
        curved = held - 2 * weight[:, None, None] * pulled[:, :, None] * error[:, None]
        own_held, own = _per_point(window, held @ by_point), _per_point(window, curved @ by_point)
        own_held += 1e-12 * (1 + np.trace(own_held, axis1=1, axis2=2)[:, None, None]) * np.eye(3)
        conditional, mixed = np.linalg.inv(own_held), _spread(window, held @ design)
        pull = _spread(window, (weight[:, None] * error)[:, None] @ design)
        by_own = _per_point(window, pulled)
        scores = (pull - (conditional @ by_own[:, :, None]).swapaxes(1, 2) @ mixed)[:, 0]
        sure = _positive(own - LEAST_SHARE * own_held)
        own[~sure], curved = np.eye(3), curved * sure[window.owners, None, None]
        bent = np.swapaxes(design, 1, 2) * (weight * sure[window.owners])[:, None, None]
        bent = bent - 2 * weight[:, None, None] * (bent @ error[:, :, None]) * error[:, None]
        with_points = _spread(window, curved @ design)
        reduced = _summed(window, bent @ design)
        half = (np.linalg.inv(np.linalg.cholesky(own)) @ with_points).reshape(-1, len(reduced))
        reduced -= half.T @ half
        return Curvature(window, design, by_point, weight, (reduced + reduced.T) / 2, scores, conditional, mixed)

    def sandwich(self, shared: float) -> Sandwich:
        """With that of the window's prior; tracks pull together `shared` times as much as each by itself."""
        return self._with_prior(self.scores, shared)

    def spread(self, sigma: float, shared: float) -> Array:
        """(D, D) how poses and corrections move with D independent unit errors: times itself transposed it is their
        covariance."""
        root, middle = self._factors(sigma)
        scatter = self._with_prior(self.left_out(root.T @ middle @ root), shared).scatter
        # By the normal equations: beside what is held, 1e12 times as sure, the digits of all else would be lost.
        values, vectors = np.linalg.eigh(root @ scatter @ root.T)
        return root.T @ middle @ (vectors * np.sqrt(np.maximum(values, 0.0)))

    def inverse(self, sigma: float) -> Array:
        """(D, D) of the second derivatives, those of the window's prior included."""
        root, middle = self._factors(sigma)
        return root.T @ middle @ root

    def _with_prior(self, scores: Array, shared: float) -> Sandwich:
        curved, scatter, prior = self.reduced.copy(), shared * scores.T @ scores, self.window.prior
        if prior is not None:
            kept = prior.sandwich or Sandwich(prior.hessian, prior.hessian)
            at = np.concatenate([np.arange(POSE * len(prior.rotations)), np.arange(len(curved) - LENS, len(curved))])
            curved[np.ix_(at, at)] += kept.curvature
            scatter[np.ix_(at, at)] += kept.scatter
        return Sandwich(curved, scatter)

    def _factors(self, sigma: float) -> tuple[Array, Array]:
        """(D, D) each, of `inverse`: the first that of the normal equations' Cholesky factor."""
        held = Equations.of(self.window, sigma).symmetric
        found = self._with_prior(self.scores, 1.0).curvature
        fixed = np.flatnonzero(self.window.extra_sigma <= 0) + len(found) - LENS
        found[fixed, fixed] = held[fixed, fixed]
        try:
            root = np.linalg.inv(np.linalg.cholesky(held))
        except np.linalg.LinAlgError:  # no minimum, to the last digits: then neither is said to be one
            return np.eye(len(held)), np.linalg.inv(held)
        share, turn = np.linalg.eigh(root @ found @ root.T)
        return root, turn / np.maximum(share, LEAST_SHARE) @ turn.T

    def left_out(self, inverse: Array) -> Array:
        """(M, D) scores as they would be, to first order, had each track had no part in the poses, with the `inverse`
        of all second derivatives: few tracks tell much of some directions, and leave little there."""
        window, moved = self.window, self.scores @ inverse
        count = POSE * len(window.rotations)
        pose = moved[:, :count].reshape(len(moved), -1, POSE)[window.owners, window.cameras]
        by_tracks = np.concatenate([pose, moved[window.owners, count:]], axis=1)
        shift = (self.design @ by_tracks[:, :, None])[..., 0]
        held = _per_point(window, ((self.weight[:, None] * shift)[:, None] @ self.by_point)[:, 0])
        back = (self.conditional @ held[:, :, None])[window.owners]
        left = self.weight[:, None] * (shift - (self.by_point @ back)[..., 0])
        return self.scores + _spread(window, left[:, None] @ self.design)[:, 0]


def _positive(m: Array) -> NDArray[np.bool_]:
    """(M,) which of the symmetric (M, 3, 3) are positive definite: by their leading minors."""
    second = m[:, 0, 0] * m[:, 1, 1] - m[:, 0, 1] ** 2
    return np.asarray((m[:, 0, 0] > 0) & (second > 0) & (np.linalg.det(m) > 0))


def _per_point(window: Window, values: Array) -> Array:
    """(M, ...) sums over the observations (K, ...) of each point."""
    first = np.searchsorted(window.owners, np.arange(len(window.points)))
    return np.add.reduceat(values, first) if len(first) else values[:0]


def _spread(window: Window, values: Array) -> Array:
    """(M, R, D) of what the observations of each point say, (K, R, 8), put to their poses and to the corrections."""
    c, rows = len(window.rotations), values.shape[1]
    out = np.zeros((len(window.points), rows, POSE * c + LENS))
    poses = out[:, :, : POSE * c].reshape(-1, rows, c, POSE)
    poses[window.owners, :, window.cameras] = values[..., :POSE]
    out[:, :, POSE * c :] = _per_point(window, values[..., POSE:])
    return out


def _summed(window: Window, blocks: Array) -> Array:
    """(D, D) sum of blocks (K, 8, 8), each at its pose and at the corrections."""
    c, size = len(window.rotations), POSE + LENS
    each = (window.cameras == np.arange(c)[:, None]).astype(float) @ blocks.reshape(-1, size * size)
    out = np.zeros((POSE * c + LENS, POSE * c + LENS))
    for i, block in enumerate(each.reshape(c, size, size)):
        at = np.concatenate([POSE * i + np.arange(POSE), POSE * c + np.arange(LENS)])
        out[np.ix_(at, at)] += block
    return out
