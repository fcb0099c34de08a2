"""Small robust least squares: a few numbers with their standard deviations, and their test on held-out stretches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array

GROUPS = 10
"""Consecutive stretches of the recording; each is left out once. They are long against the time over which the errors
of images are alike, and enough to tell how much an estimate scatters (by a quarter)."""
WIDTH = 2.5
"""Residual [standard deviations] whose weight is half: an image whose motion is wrong must not decide."""
ITERATIONS, TRIES = 20, 4
"""Steps of a fit, and halvings of a step that does not lower the cost."""
CONVERGED = 1e-3
"""A step is the last one where it is shorter than this share of a standard deviation in every number."""
LEAST_SCALE = 1e-5
"""Least noise of residuals [rad/s, m/s, m], so that exact data have a fit: no interpolation is better."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Residuals of a few numbers, which are all zero where a sensor is as stated, besides those that nobody states."""

    residuals: Callable[[Array], Array]
    """Returns (N, D) of the numbers (P,); each column has a noise of its own, which is found from the residuals."""
    steps: Array
    """(P,) steps of the numerical derivatives."""
    widest: Array
    """(P,) prior standard deviation of each number: how wrong it can be at all."""
    known: tuple[Array, Array] | None = None
    """A value (P,) and information (P, P) from another sensor, which is added."""

    def prior(self, values: Array) -> tuple[Array, Array, float]:
        """Returns information (P, P), gradient (P,) and cost of the prior."""
        information = np.diag(self.widest**-2.0)
        gradient = information @ values
        cost = float(values @ gradient)
        if self.known is not None:
            off = values - self.known[0]
            information, gradient = information + self.known[1], gradient + self.known[1] @ off
            cost += float(off @ self.known[1] @ off)
        return information, gradient, 0.5 * cost


@dataclass(frozen=True, eq=False)
class Fit:
    """The most likely numbers."""

    problem: Problem
    values: Array
    """(P,)"""
    free: NDArray[np.bool_]
    """(P,) which numbers were fitted; the others are as given."""
    scale: Array
    """(D,) noise of the residuals."""
    residuals: Array
    """(N, D) in units of that noise."""
    derivatives: Array
    """(N, D, F) of these by the free numbers."""

    @property
    def weights(self) -> Array:
        """(N,)"""
        return 1 / (1 + _squares(self.residuals) / WIDTH**2)

    @property
    def cost(self) -> float:
        """Returns the cost with the loss and the noise of this fit, without the prior."""
        return loss(self.residuals)

    @cached_property
    def information(self) -> Array:
        """(F, F) of the free numbers."""
        weighted = self.derivatives * self.weights[:, None, None]
        own = np.einsum("ndi,ndj->ij", weighted, self.derivatives)
        return own + self.problem.prior(self.values)[0][np.ix_(self.free, self.free)]

    @cached_property
    def without(self) -> Array:
        """(G, P) the numbers without each group, by one step from here."""
        weights, made = self.weights, []
        for rows in groups(len(self.residuals)):
            part = self.derivatives[rows] * weights[rows, None, None]
            information = self.information - np.einsum("ndi,ndj->ij", part, self.derivatives[rows])
            step = np.linalg.solve(information, np.einsum("ndi,nd->i", part, self.residuals[rows]))
            values = self.values.copy()
            values[self.free] += step
            made.append(values)
        return np.array(made)

    @cached_property
    def covariance(self) -> Array:
        """(P, P): that of the normal equations, widened to how much the numbers scatter without each group; 0 for what
        was not fitted."""
        found = np.zeros((len(self.values), len(self.values)))
        found[np.ix_(self.free, self.free)] = _inverse(self.information)
        count = len(self.without)
        spread = np.sqrt((count - 1) / count * ((self.without - self.without.mean(axis=0)) ** 2).sum(axis=0))
        sigma = np.sqrt(np.diag(found))
        wider = np.where(sigma > 0, np.maximum(1.0, spread / np.where(sigma > 0, sigma, 1.0)), 1.0)
        return wider[:, None] * found * wider

    @property
    def sigmas(self) -> Array:
        """(P,)"""
        return np.sqrt(np.diag(self.covariance))


def fitted(problem: Problem, start: Array, free: NDArray[np.bool_] | None = None) -> Fit:
    """Returns the fit from a start (P,); only the `free` numbers change."""
    values = np.array(start, float)
    free = np.ones(len(values), bool) if free is None else free
    for _ in range(ITERATIONS):
        fit = _linearised(problem, values, free)
        gradient = np.einsum("ndi,nd,n->i", fit.derivatives, fit.residuals, fit.weights)
        step = -np.linalg.solve(fit.information, gradient + problem.prior(values)[1][free])
        least, moved = fit.cost + problem.prior(values)[2], False
        for _ in range(TRIES):
            tried = values.copy()
            tried[free] += step
            if loss(problem.residuals(tried) / fit.scale) + problem.prior(tried)[2] <= least:
                values, moved = tried, True
                break
            step = 0.5 * step
        if not moved or (abs(step) < CONVERGED * np.sqrt(np.diag(_inverse(fit.information)))).all():
            break
    return _linearised(problem, values, free)


def _linearised(problem: Problem, values: Array, free: NDArray[np.bool_]) -> Fit:
    here = problem.residuals(values)
    scale = np.maximum(1.4826 * np.median(abs(here), axis=0), LEAST_SCALE)
    columns = []
    for i in np.flatnonzero(free):
        ends = []
        for sign in (1, -1):
            moved = values.copy()
            moved[i] += sign * problem.steps[i]
            ends.append(problem.residuals(moved))
        columns.append((ends[0] - ends[1]) / (2 * problem.steps[i]) / scale)
    return Fit(problem, values, free, scale, here / scale, np.stack(columns, axis=2))


def _inverse(information: Array) -> Array:
    """Returns the inverse of an information whose unknowns have any units."""
    size = np.sqrt(np.diag(information))
    return np.linalg.inv(information / np.outer(size, size)) / np.outer(size, size)


def _squares(residuals: Array) -> Array:
    """(N,) mean square over the columns."""
    return np.asarray((residuals**2).mean(axis=1))


def loss(residuals: Array) -> float:
    """Returns Cauchy's loss of residuals (N, D) in units of their noise."""
    return float(losses(residuals).sum())


def losses(residuals: Array) -> Array:
    """Returns the same of each row (N,)."""
    return 0.5 * residuals.shape[1] * WIDTH**2 * np.log1p(_squares(residuals) / WIDTH**2)


def groups(count: int) -> list[NDArray[np.intp]]:
    """Returns the rows of each group."""
    return [rows for rows in np.array_split(np.arange(count), GROUPS) if len(rows)]


@dataclass(frozen=True)
class HeldOut:
    """The improvement for groups that had no part in a fit."""

    gain: float
    """Share of their loss."""
    nats: float
    """The loss itself."""
    better: float
    """Share of the groups that are better, or as good."""


def held_out(full: Fit, null: Fit) -> HeldOut:
    """Returns how much better each group is explained by the full fit than by one with fewer free numbers, both without
    that group."""
    before, after = [], []
    for rows, with_, without in zip(groups(len(full.residuals)), full.without, null.without, strict=True):
        for values, found in ((without, before), (with_, after)):
            found.append(loss(full.problem.residuals(values)[rows] / full.scale))
    difference = np.array(before) - np.array(after)
    total = float(difference.sum())
    return HeldOut(total / max(sum(before), 1e-300), total, float((difference >= -1e-9).mean()))
