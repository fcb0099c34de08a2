"""Robust least squares over unknowns that all observations share, and small blocks of which each observation has one.

A board's views share the cameras, and each has a pose; tracked points share lens and poses, and each has a position.
The blocks are eliminated by their Schur complement, which leaves an equation of the size of the shared unknowns.
`scipy.optimize.least_squares` has no such elimination: on the same problems, with the same derivatives, it took 5 to 20
times as long with a sparse Jacobian, and 40 times with a dense one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.kernels import kernel
from ispom.numerics.levenberg_marquardt import FIRST, LOWEST, Minimum, minimise

T = TypeVar("T")
BEHIND = 1e8
"""Squared residual, in widths, of an observation that has no prediction, such as a point behind its camera."""
SHORT = 0.1
"""Share of a step over which its second derivative is a finite difference."""
FINE_FIRST, FINE_LOWEST = 1e-7, 1e-12
"""First and least damping along curved valleys, along which the cost curves 1e-9 times as much as across, or less."""
HIGHEST = 1e8
"""Damping at which no step is expected to lower the cost."""

Loss = Callable[[Array], tuple[Array, Array]]
"""Returns the losses (K,) and weights (K,) of squared residuals (K,), which are in units of the squared width."""


def quadratic(squares: Array) -> tuple[Array, Array]:
    """The loss of normally distributed errors."""
    return squares, np.ones_like(squares)


def cauchy(squares: Array) -> tuple[Array, Array]:
    """Cauchy's loss: a residual of one width has half the weight of a small one."""
    return np.log1p(squares), 1 / (1 + squares)


def huber(limit: float) -> Loss:
    """Returns Huber's loss, which is linear beyond `limit` widths."""

    def loss(squares: Array) -> tuple[Array, Array]:
        sizes = np.sqrt(squares)
        return np.where(sizes <= limit, squares, limit * (2 * sizes - limit)), limit / np.maximum(sizes, limit)

    return loss


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of the residuals."""

    by_shared: Array
    """(K, 2, C) by the shared unknowns that the observation depends on,"""
    columns: NDArray[np.int64]
    """(K, C) and which ones these are; -1 for one that is fixed."""
    by_block: Array
    """(K, 2, D) by the observation's own block,"""
    block: NDArray[np.int64]
    """(K,) and which one that is."""


class Problem(ABC, Generic[T]):
    """What is adjusted: how residuals follow from the values, and values from a step."""

    shared: int
    """G, the number of free shared unknowns."""
    blocks: int
    """N, the number of blocks."""
    widths: Array
    """(K,) standard deviations of the observations, or widths of their robust loss."""

    @abstractmethod
    def residuals(self, values: T) -> Array:
        """Returns predicted minus observed values (K, 2); NaN where there is no prediction."""

    @abstractmethod
    def derivatives(self, values: T) -> Derivatives:
        """Returns the derivatives of the residuals; finite where there is no prediction."""

    @abstractmethod
    def moved(self, values: T, shared: Array, blocks: Array) -> T:
        """Returns the values after a step (G,) of the shared unknowns and (N, D) of the blocks."""

    def prior(self, values: T) -> tuple[Array, Array]:
        """Returns the shared unknowns' differences (G,) from their prior means, and the prior's information (G,)."""
        return np.zeros(self.shared), np.zeros(self.shared)


@dataclass(frozen=True, eq=False)
class Eliminated:
    """Normal equations of the shared unknowns alone."""

    matrix: Array
    """(G, G) Schur complement."""
    inverse: Array
    """(N, D, D) of the blocks."""
    mixed: Array
    """(N, D, G)."""

    def solve(self, shared_gradient: Array, block_gradients: Array) -> tuple[Array, Array]:
        """Returns the step (G,) and (N, D) to the least cost."""
        inner = (self.inverse @ block_gradients[..., None])[..., 0]
        gradient = shared_gradient - np.tensordot(inner, self.mixed, 2)
        scale = 1 / np.sqrt(np.maximum(np.diag(self.matrix), 1e-30))
        scaled = self.matrix * np.outer(scale, scale)
        try:
            shared = -scale * np.linalg.solve(scaled, scale * gradient)
        except np.linalg.LinAlgError:
            shared = -scale * np.linalg.lstsq(scaled, scale * gradient, rcond=1e-15)[0]
        return shared, -inner - (self.inverse @ (self.mixed @ shared)[..., None])[..., 0]

    def scores(self, equations: NormalEquations) -> Array:
        """Returns each block's part (N, G) of the gradient of the shared unknowns alone, for a sandwich covariance."""
        inner = self.inverse @ equations.block_gradients[..., None]
        return equations.scores - (np.swapaxes(inner, 1, 2) @ self.mixed)[:, 0]


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """J'WJ and J'Wr of shared unknowns (G) and blocks (N, D)."""

    shared: Array
    """(G, G)."""
    mixed: Array
    """(N, D, G)."""
    blocks: Array
    """(N, D, D)."""
    scores: Array
    """(N, G) each block's part of the shared unknowns' gradient."""
    shared_gradient: Array
    """(G,) with the prior's part."""
    block_gradients: Array
    """(N, D)."""

    def eliminated(self, damping: float) -> Eliminated:
        """Eliminates the blocks; `damping` is added to all diagonals, as a share of them."""
        own = np.eye(self.blocks.shape[1])
        inverse = np.linalg.inv(self.blocks * (1 + damping * own) + 1e-12 * own)
        root = np.swapaxes(np.linalg.cholesky(inverse), 1, 2)
        half = (root @ self.mixed).reshape(self.block_gradients.size, -1)  # half.T @ half is symmetric: half the work
        return Eliminated(self.shared + np.diag(damping * np.diag(self.shared)) - half.T @ half, inverse, self.mixed)

    def step(self, damping: float) -> tuple[Array, Array]:
        """Returns the step (G,) and (N, D) that lowers the cost."""
        return self.eliminated(damping).solve(self.shared_gradient, self.block_gradients)


def normal_equations(problem: Problem[T], values: T, loss: Loss = quadratic) -> NormalEquations:
    """Computes the normal equations at the values."""
    return _linearised(problem, values, loss)[0]


def cost(problem: Problem[T], values: T, loss: Loss = quadratic) -> float:
    """Returns half the sum of losses, with the prior's part."""
    away, information = problem.prior(values)
    return 0.5 * float(loss(_squares(problem, problem.residuals(values)))[0].sum() + information @ away**2)


def adjust(
    problem: Problem[T],
    start: T,
    loss: Loss,
    iterations: int,
    tolerance: float,
    curved: bool = False,
) -> Minimum[T]:
    """Minimises the cost from `start` on by Levenberg-Marquardt.

    `curved` is for narrow and bent valleys, as where focal length, depths and rotations are correlated: a straight
    step soon leaves them and is rejected. Geodesic acceleration (Transtrum & Sethna, arXiv:1201.5885) corrects a step
    by the residuals' second derivative along it, with the same equations.
    """
    linearised_at: list = [None, None]

    def stepped(values: T, damping: float) -> T:
        if linearised_at[0] is not values:  # a rejected step is followed by another one from the same values
            linearised_at[:] = values, _linearised(problem, values, loss)
        equations, derivatives, weights = linearised_at[1]
        eliminated = equations.eliminated(damping)
        shared, blocks = eliminated.solve(equations.shared_gradient, equations.block_gradients)
        if curved:
            ends = [problem.residuals(problem.moved(values, s * shared, s * blocks)) for s in (-SHORT, SHORT)]
            second = np.nan_to_num((ends[0] - 2 * problem.residuals(values) + ends[1]) / SHORT**2)
            scores, pull = _gradients(problem, derivatives, second, weights)
            more, more_blocks = eliminated.solve(scores.sum(0), pull)
            shared, blocks = shared + 0.5 * more, blocks + 0.5 * more_blocks
        return problem.moved(values, shared, blocks)

    first, lowest = (FINE_FIRST, FINE_LOWEST) if curved else (FIRST, LOWEST)
    return minimise(
        start, lambda values: cost(problem, values, loss), stepped, iterations, tolerance, HIGHEST, first, lowest
    )


def _squares(problem: Problem[T], residuals: Array) -> Array:
    return np.nan_to_num((residuals**2).sum(1) / problem.widths**2, nan=BEHIND)


def _linearised(problem: Problem[T], values: T, loss: Loss) -> tuple[NormalEquations, Derivatives, Array]:
    """Returns the equations, and the derivatives and weights (K,) that they are made of."""
    residuals, derivatives = problem.residuals(values), problem.derivatives(values)
    valid = np.isfinite(residuals).all(1)
    weights = np.where(valid, loss(_squares(problem, residuals))[1] / problem.widths**2, 0.0)
    d = derivatives
    shared, mixed, blocks = _matrices(
        d.by_shared, d.columns, d.by_block, d.block, weights, problem.shared, problem.blocks
    )
    scores, block_gradients = _gradients(problem, derivatives, np.nan_to_num(residuals), weights)
    away, information = problem.prior(values)
    gradient = scores.sum(0) + information * away
    equations = NormalEquations(shared + np.diag(information), mixed, blocks, scores, gradient, block_gradients)
    return equations, derivatives, weights


def _gradients(problem: Problem[T], d: Derivatives, residuals: Array, weights: Array) -> tuple[Array, Array]:
    """Returns each block's part of the shared gradient (N, G), and the gradients of the blocks (N, D)."""
    weighted = weights[:, None] * residuals
    scores, own = np.zeros((problem.blocks, problem.shared)), np.zeros((problem.blocks, d.by_block.shape[2]))
    _add_gradients(d.by_shared, d.columns, d.by_block, d.block, weighted, scores, own)
    return scores, own


@kernel()
def _add_gradients(by_shared, columns, by_block, block, weighted, scores, own):
    for k in range(len(block)):
        b = block[k]
        for i in range(columns.shape[1]):
            if columns[k, i] >= 0:
                scores[b, columns[k, i]] += by_shared[k, 0, i] * weighted[k, 0] + by_shared[k, 1, i] * weighted[k, 1]
        for i in range(by_block.shape[2]):
            own[b, i] += by_block[k, 0, i] * weighted[k, 0] + by_block[k, 1, i] * weighted[k, 1]


@kernel()
def _matrices(by_shared, columns, by_block, block, weights, n_shared, n_blocks):
    """The matrices of shared unknowns (G, G), of both (N, D, G), and of blocks (N, D, D)."""
    size = by_block.shape[2]
    shared, mixed = np.zeros((n_shared, n_shared)), np.zeros((n_blocks, size, n_shared))
    blocks = np.zeros((n_blocks, size, size))
    for k in range(len(block)):
        b = block[k]
        for i in range(columns.shape[1]):
            c = columns[k, i]
            if c < 0:
                continue
            u, v = weights[k] * by_shared[k, 0, i], weights[k] * by_shared[k, 1, i]
            for j in range(columns.shape[1]):
                if columns[k, j] >= 0:
                    shared[c, columns[k, j]] += u * by_shared[k, 0, j] + v * by_shared[k, 1, j]
            for j in range(size):
                mixed[b, j, c] += u * by_block[k, 0, j] + v * by_block[k, 1, j]
        for i in range(size):
            u, v = weights[k] * by_block[k, 0, i], weights[k] * by_block[k, 1, i]
            for j in range(size):
                blocks[b, i, j] += u * by_block[k, 0, j] + v * by_block[k, 1, j]
    return shared, mixed, blocks
