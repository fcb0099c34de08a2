"""Robust least squares over unknowns that all residuals share, and small blocks of which each residual has at most one.

A problem is a list of families of residuals. A board's views share the cameras, and each has a pose; tracked points
share lens and poses, and each has a position. The blocks are eliminated by their Schur complement, which leaves an
equation of the size of the shared unknowns.
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
from ispom.numerics.levenberg_marquardt import FIRST_DAMPING, LOWEST_DAMPING, Minimum, minimise

T = TypeVar("T")
SQUARE_BEHIND = 1e8
"""Squared residual, in squared widths, of an observation without a prediction, such as a point behind its camera."""
CURVATURE_STEP = 0.1
"""Share of a step over which the residuals' second derivative along it is computed by finite differences."""
FINE_FIRST, FINE_LOWEST = 1e-7, 1e-12
"""First and least damping along curved valleys, along which the cost curves 1e-9 times as much as across, or less."""
SETTLED = 0.1
"""Share of a standard deviation: an unknown that is nearer to the minimum has settled. A tenth adds half a percent to
its error."""
MOST_SHARE = 0.9
"""Largest ratio of successive steps by which a way is extrapolated: above it they have not converged."""
HIGHEST_DAMPING = 1e8
"""Damping at which no step is expected to lower the cost."""

Loss = Callable[[Array], tuple[Array, Array]]
"""Returns the losses (K,) and weights (K,) of squared residuals (K,), which are in units of the squared width."""


def quadratic(squares: Array) -> tuple[Array, Array]:
    """Returns the loss of normally distributed errors."""
    return squares, np.ones_like(squares)


def huber(limit: float) -> Loss:
    """Returns Huber's loss, which is linear beyond `limit` widths."""

    def loss(squares: Array) -> tuple[Array, Array]:
        sizes = np.sqrt(squares)
        return np.where(sizes <= limit, squares, limit * (2 * sizes - limit)), limit / np.maximum(sizes, limit)

    return loss


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of K residuals of R rows."""

    by_shared: Array
    """(K, R, C) derivatives by the shared unknowns that the residual depends on."""
    columns: NDArray[np.int64]
    """(K, C) indices of these unknowns; -1 for one that is fixed."""
    by_block: Array
    """(K, R, D) derivatives by the residual's own block."""
    block: NDArray[np.int64]
    """(K,) index of this block; -1 for none."""

    @staticmethod
    def of_shared(by_shared: Array, columns: NDArray[np.int64]) -> Derivatives:
        """Returns the derivatives of residuals without a block."""
        count, rows, _ = by_shared.shape
        return Derivatives(by_shared, columns, np.zeros((count, rows, 0)), np.full(count, -1))

    def contiguous(self) -> Derivatives:
        """Returns the same in contiguous arrays, for which the kernels are compiled."""
        floats = [np.require(each, requirements=("C", "W")) for each in (self.by_shared, self.by_block)]
        whole = [np.require(each, np.int64, ("C", "W")) for each in (self.columns, self.block)]
        return Derivatives(floats[0], whole[0], floats[1], whole[1])


class Family(ABC, Generic[T]):
    """Residuals of one kind, with their derivatives, widths and loss.

    Image points are one family, a prior is another one. Cost, normal equations, elimination and covariance treat all
    families of a problem in the same way: a new term is a new family.
    """

    widths: Array
    """(K,) standard deviations of the residuals' rows, or widths of their robust loss."""
    loss: Loss = staticmethod(quadratic)

    @abstractmethod
    def residuals(self, values: T) -> Array:
        """Returns predicted minus observed values (K, R); NaN where there is no prediction."""

    @abstractmethod
    def derivatives(self, values: T) -> Derivatives:
        """Returns the derivatives of the residuals; finite where there is no prediction."""


@dataclass(frozen=True, eq=False)
class Prior(Family[T]):
    """An independent prior of each of P shared unknowns."""

    away: Callable[[T], Array]
    """Returns the unknowns' differences (P,) from their means."""
    widths: Array
    columns: NDArray[np.int64]
    """(P,) indices of these shared unknowns."""

    def residuals(self, values: T) -> Array:
        return self.away(values)[:, None]

    def derivatives(self, values: T) -> Derivatives:
        return Derivatives.of_shared(np.ones((len(self.columns), 1, 1)), self.columns[:, None])


@dataclass(frozen=True, eq=False)
class Problem(Generic[T]):
    """The residuals, the unknowns, and how values follow from a step."""

    families: tuple[Family[T], ...]
    moved: Callable[[T, Array, Array], T]
    """Returns the values after a step (G,) of the shared unknowns and (N, D) of the blocks."""
    shared: int
    """G, the number of free shared unknowns."""
    blocks: int = 0
    """N, the number of blocks."""
    size: int = 0
    """D, the number of unknowns in each."""


@dataclass(frozen=True, eq=False)
class Eliminated:
    """Normal equations of the shared unknowns alone."""

    matrix: Array
    """(G, G) Schur complement."""
    inverse: Array
    """(N, D, D) of the blocks."""
    mixed: Array
    """(N, D, G)."""

    def gradient(self, shared_gradient: Array, block_gradients: Array) -> Array:
        """Returns the gradient (G,) of the shared unknowns when the blocks follow them."""
        return shared_gradient - np.tensordot((self.inverse @ block_gradients[..., None])[..., 0], self.mixed, 2)

    def solve(self, shared_gradient: Array, block_gradients: Array) -> tuple[Array, Array]:
        """Returns the step (G,) and (N, D) to the least cost."""
        inner = (self.inverse @ block_gradients[..., None])[..., 0]
        gradient = self.gradient(shared_gradient, block_gradients)
        shared = -self._solved(gradient[:, None])[:, 0]
        return shared, -inner - (self.inverse @ (self.mixed @ shared)[..., None])[..., 0]

    def sigmas(self, count: int) -> Array:
        """Returns the standard deviations (count,) of the first shared unknowns."""
        first = np.eye(len(self.matrix), count)
        return np.sqrt(np.maximum((first * self._solved(first)).sum(0), 0.0))

    def _solved(self, right: Array) -> Array:
        """Returns the inverse of the matrix times the right side (G, R)."""
        scale = 1 / np.sqrt(np.maximum(np.diag(self.matrix), 1e-30))[:, None]
        scaled = self.matrix * scale * scale.T
        try:
            return scale * np.linalg.solve(scaled, scale * right)
        except np.linalg.LinAlgError:
            return scale * np.linalg.lstsq(scaled, scale * right, rcond=1e-15)[0]

    def block_covariances(self, shared: Array) -> Array:
        """Returns the covariances (N, D, D) of the blocks, from that of the shared unknowns (G, G)."""
        by_shared = self.inverse @ self.mixed
        return self.inverse + by_shared @ shared @ np.swapaxes(by_shared, 1, 2)

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
    """(G,) whole gradient, including residuals without a block."""
    block_gradients: Array
    """(N, D)."""

    def eliminated(self, damping: float, narrow: bool = False) -> Eliminated:
        """Eliminates the blocks. `damping` raises all diagonals by this share of them: those of the shared unknowns
        before the elimination, or after it with `narrow`."""
        own = np.eye(self.blocks.shape[1])
        # By the factors of the blocks: the inverse of a nearly singular one is positive but for its rounding.
        root = np.linalg.inv(np.linalg.cholesky(self.blocks * (1 + damping * own) + 1e-12 * own))
        inverse = np.swapaxes(root, 1, 2) @ root
        half = (root @ self.mixed).reshape(self.block_gradients.size, len(self.shared))
        matrix = self.shared - half.T @ half  # a symmetric product: half the work
        diagonal = np.diag(matrix if narrow else self.shared)
        return Eliminated(matrix + np.diag(damping * diagonal), inverse, self.mixed)

    def step(self, damping: float) -> tuple[Array, Array]:
        """Returns the step (G,) and (N, D) that lowers the cost."""
        return self.eliminated(damping).solve(self.shared_gradient, self.block_gradients)


def normal_equations(problem: Problem[T], values: T) -> NormalEquations:
    """Computes the normal equations at the values."""
    return _Linearised.of(problem, values).equations()


def cost(problem: Problem[T], values: T) -> float:
    """Returns half the sum of losses."""
    return 0.5 * sum(float(each.loss(_squares(each, each.residuals(values)))[0].sum()) for each in problem.families)


def adjust(
    problem: Problem[T],
    start: T,
    iterations: int,
    tolerance: float,
    narrow: bool = False,
    curved: bool = False,
    sought: int = 0,
) -> Minimum[T]:
    """Minimises the cost from `start` on by Levenberg-Marquardt.

    `narrow` is for correlated unknowns, as where the scale is nearly free: they are damped less. `curved` is for
    narrow, bent valleys of the cost, as where focal length, depths and rotations are correlated: a straight step soon
    leaves them and is rejected. Geodesic acceleration (Transtrum & Sethna, arXiv:1201.5885) corrects a step by the
    residuals' second derivative along it, with the same equations. `sought` is the number of first shared unknowns that
    the caller needs: the iterations also end when these have converged.
    """
    linearised_at: list = [None, None, None]
    course = _Course(sought)

    def stepped(values: T, damping: float) -> T:
        if linearised_at[0] is not values:  # a rejected step is followed by another one from the same values
            linearised = _Linearised.of(problem, values)
            linearised_at[:] = values, linearised, linearised.equations()
        _, linearised, equations = linearised_at
        eliminated = equations.eliminated(damping, narrow)
        shared, blocks = eliminated.solve(equations.shared_gradient, equations.block_gradients)
        if curved:
            ends = [problem.moved(values, s * shared, s * blocks) for s in (-CURVATURE_STEP, CURVATURE_STEP)]
            second = [
                np.nan_to_num((each.residuals(ends[0]) - 2 * now + each.residuals(ends[1])) / CURVATURE_STEP**2)
                for each, now in zip(problem.families, linearised.residuals, strict=True)
            ]
            _, pull, block_pull = linearised.gradients(second)
            more, more_blocks = eliminated.solve(pull, block_pull)
            shared, blocks = shared + 0.5 * more, blocks + 0.5 * more_blocks
        course.tried(shared, eliminated)
        return problem.moved(values, shared, blocks)

    first, lowest = (FINE_FIRST, FINE_LOWEST) if curved else (FIRST_DAMPING, LOWEST_DAMPING)
    return minimise(
        start,
        lambda values: cost(problem, values),
        stepped,
        iterations,
        tolerance,
        HIGHEST_DAMPING,
        first,
        lowest,
        course.settled,
    )


def remaining_change(last: Array, step: Array) -> Array:
    """Extrapolates values (N,) after two steps by a geometric series.

    Steps that do not shrink show that the values have not converged, not by how much.
    """
    share = np.clip(step / np.where(last == 0, np.inf, last), -MOST_SHARE, MOST_SHARE)
    return step * share / (1 - share)


class _Course:
    """The steps of the unknowns that the caller needs."""

    def __init__(self, sought: int) -> None:
        self.sought = sought
        self.last, self.step, self.sigma = np.full(sought, np.nan), np.full(sought, np.nan), np.zeros(sought)

    def tried(self, shared: Array, eliminated: Eliminated) -> None:
        """Keeps a step (G,) that may be taken."""
        if self.sought:
            self.step, self.sigma = shared[: self.sought], eliminated.sigmas(self.sought)

    def settled(self) -> bool:
        """Adds a step. Returns whether the remaining change is small for each unknown's standard deviation."""
        last, self.last = self.last, self.step
        return self.sought > 0 and bool((np.abs(remaining_change(last, self.step)) < SETTLED * self.sigma).all())


def _squares(family: Family[T], residuals: Array) -> Array:
    return np.nan_to_num((residuals**2).sum(1) / family.widths**2, nan=SQUARE_BEHIND)


@dataclass(frozen=True, eq=False)
class _Linearised(Generic[T]):
    """The families of a problem at some values."""

    problem: Problem[T]
    residuals: list[Array]
    derivatives: list[Derivatives]
    weights: list[Array]
    """(K,) of each family."""

    @staticmethod
    def of(problem: Problem[T], values: T) -> _Linearised[T]:
        residuals, derivatives, weights = [], [], []
        for family in problem.families:
            away = family.residuals(values)
            weight = family.loss(_squares(family, away))[1] / family.widths**2
            residuals.append(np.nan_to_num(away))
            derivatives.append(family.derivatives(values).contiguous())
            weights.append(np.where(np.isfinite(away).all(1), weight, 0.0))
        return _Linearised(problem, residuals, derivatives, weights)

    def equations(self) -> NormalEquations:
        p = self.problem
        shared, mixed = np.zeros((p.shared, p.shared)), np.zeros((p.blocks, p.size, p.shared))
        blocks = np.zeros((p.blocks, p.size, p.size))
        for d, weights in zip(self.derivatives, self.weights, strict=True):
            _add_matrices(d.by_shared, d.columns, d.by_block, d.block, weights, shared, mixed, blocks)
        scores, gradient, own = self.gradients(self.residuals)
        return NormalEquations(shared, mixed, blocks, scores, gradient, own)

    def gradients(self, residuals: list[Array]) -> tuple[Array, Array, Array]:
        """Returns each block's part of the shared gradient (N, G), that gradient (G,), and those of the blocks (N, D),
        with these residuals in place of its own."""
        p = self.problem
        scores, others, own = np.zeros((p.blocks, p.shared)), np.zeros(p.shared), np.zeros((p.blocks, p.size))
        for d, weights, away in zip(self.derivatives, self.weights, residuals, strict=True):
            _add_gradients(d.by_shared, d.columns, d.by_block, d.block, weights[:, None] * away, scores, others, own)
        return scores, scores.sum(0) + others, own


@kernel()
def _add_gradients(by_shared, columns, by_block, block, weighted, scores, others, own):
    """Adds the residuals to each block's part of the shared gradient (N, G), to the part without a block (G,), and to
    the blocks' own gradients (N, D)."""
    for k in range(len(block)):
        b = block[k]
        for i in range(columns.shape[1]):
            c = columns[k, i]
            if c < 0:
                continue
            total = 0.0
            for r in range(by_shared.shape[1]):
                total += by_shared[k, r, i] * weighted[k, r]
            if b < 0:
                others[c] += total
            else:
                scores[b, c] += total
        for i in range(by_block.shape[2]):
            for r in range(by_block.shape[1]):
                own[b, i] += by_block[k, r, i] * weighted[k, r]


@kernel()
def _add_matrices(by_shared, columns, by_block, block, weights, shared, mixed, blocks):
    """Adds the residuals to the matrices of shared unknowns (G, G), of both (N, D, G), and of blocks (N, D, D)."""
    rows, size = by_shared.shape[1], by_block.shape[2]
    for k in range(len(block)):
        b, weight = block[k], weights[k]
        for i in range(columns.shape[1]):
            c = columns[k, i]
            if c < 0:
                continue
            for j in range(i + 1):
                e = columns[k, j]
                if e >= 0:
                    total = 0.0
                    for r in range(rows):
                        total += by_shared[k, r, i] * by_shared[k, r, j]
                    shared[c, e] += weight * total
                    if i != j:
                        shared[e, c] += weight * total
            for j in range(size):
                total = 0.0
                for r in range(rows):
                    total += by_shared[k, r, i] * by_block[k, r, j]
                mixed[b, j, c] += weight * total
        for i in range(size):
            for j in range(size):
                total = 0.0
                for r in range(rows):
                    total += by_block[k, r, i] * by_block[k, r, j]
                blocks[b, i, j] += weight * total
