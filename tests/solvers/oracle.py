"""A general solver for the same problems: `scipy.optimize.least_squares`, Jacobians by differences, no elimination.

Nothing here comes from the solvers under test but the data they are given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ispom.geometry import Array, Pose, so3_exp, so3_log
from ispom.solvers.window.adjustment import Window
from ispom.solvers.window.prior import Prior


def cauchy(errors: Array) -> Array:
    """Errors (K, D) so that half their sum of squares is that of log(1 + |e|^2): each row has one weight."""
    square = (errors**2).sum(axis=1, keepdims=True)
    safe = np.where(square > 1e-12, square, 1.0)
    return errors * np.where(square > 1e-12, np.sqrt(np.log1p(safe) / safe), 1 - square / 4)


def least(residuals: Callable[[Array], Array], count: int) -> tuple[Array, float]:
    """The unknowns (count,) of least cost, from zero on, and half the sum of squares there."""
    found = least_squares(residuals, np.zeros(count), "3-point", x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    return found.x, float(found.cost)


def adjusted(window: Window, scale: float) -> tuple[Window, float]:
    """A window's minimum and its cost, as window.adjust."""
    poses, points, extras = 6 * (len(window.rotations) - window.fixed), window.points.size, len(window.extra)
    free = window.extra_sigma > 0

    def at(x: Array) -> tuple[Array, Array, Array, Array]:
        twists = np.zeros((len(window.rotations), 6))
        twists[window.fixed :] = x[:poses].reshape(-1, 6)
        turn = so3_exp(twists[:, 3:])
        translations = np.einsum("cij,cj->ci", turn, window.translations) + twists[:, :3]
        extra = window.extra + np.where(free, x[poses + points :] * np.where(free, window.extra_sigma, 1.0), 0.0)
        return turn @ window.rotations, translations, window.points + x[poses:-extras].reshape(-1, 3), extra

    def residuals(x: Array) -> Array:
        rotations, translations, xyz, extra = at(x)
        q = np.einsum("kij,kj->ki", rotations[window.cameras], xyz[window.owners]) + translations[window.cameras]
        errors = cauchy(image_errors(q, window, extra) / scale).ravel()
        if window.prior is None:
            return np.concatenate([errors, (extra / np.where(free, window.extra_sigma, np.inf))[free]])
        return np.concatenate([errors, prior_residual(window.prior, rotations, translations, extra, free)])

    x, cost = least(residuals, poses + points + extras)
    rotations, translations, xyz, extra = at(x)
    return replace(window, rotations=rotations, translations=translations, points=xyz, extra=extra), cost


def image_errors(q: Array, window: Window, extra: Array) -> Array:
    """(K, 3) of points q (K, 3) in their cameras, written as the fields of window.Window say."""
    x, y = q[:, 0] / q[:, 2], q[:, 1] / q[:, 2]
    if window.baseline == 0:
        stretch = 1 + extra[0] + extra[1] * (x**2 + y**2)
        return np.column_stack([x * stretch - window.seen[:, 0], y * stretch - window.seen[:, 1], 0 * x])
    right = (q[:, 0] - window.baseline) / q[:, 2]
    wrong = window.factors @ extra[: window.factors.shape[1]]
    left = window.seen[:, :2]
    for _ in range(20):
        square = (left**2).sum(1)
        left = window.seen[:, :2] / (1 + extra[0] * square + extra[1] * square**2)[:, None]
    third = np.where(np.isnan(window.seen[:, 2]), 0.0, right + wrong - np.nan_to_num(window.seen[:, 2]))
    return np.column_stack([x - left[:, 0], y - left[:, 1], third])


def prior_residual(prior: Prior, rotations: Array, translations: Array, extra: Array, free: NDArray[np.bool_]) -> Array:
    """Half its square is the prior's cost up to a constant: by the square root of the information."""
    p = len(prior.rotations)
    turn = rotations[:p] @ np.swapaxes(prior.rotations, 1, 2)
    shift = translations[:p] - np.einsum("pij,pj->pi", turn, prior.translations)
    moved = np.concatenate([np.hstack([shift, so3_log(turn)]).ravel(), extra - prior.extra])
    varied = np.flatnonzero(np.concatenate([np.ones(6 * p, bool), free]))
    values, vectors = np.linalg.eigh(prior.hessian[np.ix_(varied, varied)])
    kept = values > 1e-9 * values.max()
    root = np.sqrt(values[kept])
    return root * (vectors.T @ moved[varied])[kept] + (vectors.T @ prior.gradient[varied])[kept] / root


def located(xyz: Array, seen: Array, guess: Pose, scale: float, baseline: float = 0.0) -> tuple[Pose, float]:
    """A camera's pose of least Cauchy cost, from points (N, 3) seen at (N, 2) or (N, 3), as localisation.fit_pose."""

    def at(x: Array) -> Pose:
        return Pose(so3_exp(x[3:]) @ guess.rotation, so3_exp(x[3:]) @ guess.translation + x[:3])

    def residuals(x: Array) -> Array:
        q = at(x).apply(xyz)
        image = np.column_stack([q[:, :2] / q[:, 2:], (q[:, 0] - baseline) / q[:, 2]])[:, : seen.shape[1]]
        return cauchy((image - seen) / scale).ravel()

    x, cost = least(residuals, 6)
    return at(x), cost
