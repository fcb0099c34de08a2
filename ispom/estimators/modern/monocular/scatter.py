"""What the covariance of a window is made of: how its cost curves, and how far its gradient scatters.

A sandwich (Huber 1967; White 1982): an estimate is off by H^-1 g, so its covariance is H^-1 S H^-1, with S the
covariance of the gradient g where the truth is. The normal equations alone would take every error to be independent,
and of one size; and they hold the loss's weights fixed, which takes some directions for half as sure again as they are:
the points that say most of a short way are near ones, and just these have large errors. So H has the loss's own second
derivatives, and S is the sum of what the tracks say each by itself: whatever its errors are from view to view, and
however large, they are in there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.geometry import Array
from ispom.numerics.reprojection import reprojected
from ispom.solvers.window.adjustment import Window
from ispom.solvers.window.prior import LENS, POSE

LEAST_SHARE = 0.1
"""Of its curvature with weights held, that a point must keep; one that has less tells nothing of the poses."""


@dataclass(frozen=True, eq=False)
class Curvature:
    """Derivatives of a window's cost, without its prior; D = 6 C + 2, by left twists of the poses and corrections."""

    reduced: Array
    """(D, D) second ones, the points eliminated."""
    scores: Array
    """(M, D) first ones, of each point, that eliminated."""
    conditional: Array
    """(M, 3, 3) inverse of each point's own second ones, weights held."""
    mixed: Array
    """(M, 3, D) second ones by point, and pose or correction, weights held."""
    terms: tuple = ()

    @staticmethod
    def of(window: Window, sigma: float) -> Curvature:
        """`sigma`: width of the loss, normalised."""
        c, m, k, owners = len(window.rotations), len(window.points), window.cameras, window.owners
        size, turns = POSE * c + LENS, window.rotations[k]
        if not m:
            return Curvature(np.zeros((size, size)), np.zeros((0, size)), np.zeros((0, 3, 3)), np.zeros((0, 3, size)))
        near = (turns @ window.points[owners][:, :, None])[..., 0] + window.translations[k]
        uv, by_place, by_pose = reprojected(near)
        square = (uv**2).sum(axis=1, keepdims=True)
        error = (1 + window.extra[0] + window.extra[1] * square) * uv - window.seen[:, :2]
        weight = 1 / (sigma**2 + (error**2).sum(axis=1))
        by_point, by_extra = by_place @ turns, np.stack([uv, uv * square], axis=2)
        first = np.searchsorted(owners, np.arange(m))
        held = np.swapaxes(by_point, 1, 2) * weight[:, None, None]
        curved = held - 2 * weight[:, None, None] ** 2 * (np.swapaxes(by_point, 1, 2) @ error[:, :, None]) @ error[:, None]
        own_held, own = (np.add.reduceat(a @ by_point, first) for a in (held, curved))
        conditional = np.linalg.inv(own_held + 1e-12 * np.eye(3))
        # of each point the curvature that is left, in the worst direction
        root = np.linalg.cholesky(own_held + 1e-12 * np.eye(3))
        inner = np.linalg.solve(root, np.swapaxes(np.linalg.solve(root, own), 1, 2))
        good = np.linalg.eigvalsh(inner)[:, 0] > LEAST_SHARE
        mixed, mixed_held, scores = np.zeros((m, 3, size)), np.zeros((m, 3, size)), np.zeros((m, size))
        pull = weight[:, None] * error
        total = np.zeros((size, size))
        full = weight[:, None, None] * np.eye(2) - 2 * weight[:, None, None] ** 2 * error[:, :, None] * error[:, None]
        full *= good[owners][:, None, None]
        twice, corner = full @ by_pose, full @ by_extra
        e = slice(size - LENS, size)
        for i in range(c):
            mine, at = k == i, slice(POSE * i, POSE * (i + 1))
            mixed_held[owners[mine], :, at] = held[mine] @ by_pose[mine]
            mixed[owners[mine], :, at] = np.swapaxes(by_point[mine], 1, 2) @ twice[mine]
            scores[owners[mine], at] = (pull[mine, None] @ by_pose[mine])[:, 0]
            total[at, at] = np.tensordot(by_pose[mine], twice[mine], ((0, 1), (0, 1)))
            total[at, e] = np.tensordot(by_pose[mine], corner[mine], ((0, 1), (0, 1)))
            total[e, at] = total[at, e].T
        mixed_held[:, :, e] = np.add.reduceat(held @ by_extra, first)
        mixed[:, :, e] = np.add.reduceat(np.swapaxes(by_point, 1, 2) @ corner, first)
        scores[:, e] = np.add.reduceat((pull[:, None] @ by_extra)[:, 0], first)
        total[e, e] = np.tensordot(by_extra, corner, ((0, 1), (0, 1)))
        own[~good] = np.eye(3)
        gain = np.linalg.solve(own, mixed)
        total -= np.tensordot(mixed, gain, ((0, 1), (0, 1)))
        by_own = np.add.reduceat((pull[:, None] @ by_point)[:, 0], first)
        scores -= (by_own[:, None] @ (conditional @ mixed_held))[:, 0]
        return Curvature((total + total.T) / 2, scores, conditional, mixed_held, (window, by_pose, by_extra, by_point, weight, first))


def left_out(curved, inverse, times=1, alpha=1.0):
    window, by_pose, by_extra, by_point, weight, first = curved.terms
    owners, k, c = window.owners, window.cameras, len(window.rotations)
    size = curved.scores.shape[1]
    out = curved.scores.copy()
    term = curved.scores
    for _ in range(times):
        x = term @ inverse
        u = (by_extra @ x[owners, size - LENS:, None])[..., 0]
        for i in range(c):
            mine = k == i
            u[mine] += (by_pose[mine] @ x[owners[mine], POSE * i:POSE * i + POSE, None])[..., 0]
        y = np.add.reduceat((weight[:, None, None] * u[:, None] @ by_point)[:, 0], first)
        y = (curved.conditional @ y[..., None])[..., 0]
        u = weight[:, None] * (u - (by_point @ y[owners, :, None])[..., 0])
        term = np.zeros_like(out)
        for i in range(c):
            mine = k == i
            term[owners[mine], POSE * i:POSE * i + POSE] = (u[mine, None] @ by_pose[mine])[:, 0]
        term[:, size - LENS:] = np.add.reduceat((u[:, None] @ by_extra)[:, 0], first)
        out += alpha * term
    return out


def scatter(window: Window, scores: Array, shared: float) -> Array:
    """(D, D) covariance of the gradient, of a window with a prior, and the scores of its tracks (M, D); `shared`:
    by how much more these pull together than apart."""
    found, prior, size = shared * scores.T @ scores, window.prior, scores.shape[1]
    if prior is not None and prior.scatter is not None:
        at = np.r_[0 : POSE * len(prior.rotations), size - LENS : size]
        found[np.ix_(at, at)] += prior.scatter
    return found


def with_prior(window: Window, reduced: Array) -> Array:
    """Second derivatives (D, D), the prior's included."""
    found, prior, size = reduced.copy(), window.prior, len(reduced)
    if prior is not None:
        at = np.r_[0 : POSE * len(prior.rotations), size - LENS : size]
        found[np.ix_(at, at)] += prior.hessian
    held = np.flatnonzero(window.extra_sigma <= 0) + size - LENS
    found[held, held] += 1e30
    return found
