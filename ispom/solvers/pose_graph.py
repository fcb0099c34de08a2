"""Pose graph optimisation from measured relative poses (Grisetti et al. 2010; Strasdat et al. 2010).

A pose is a Similarity world_from_node: the scale of one camera drifts as well, that of a stereo pair is fixed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array, csr_array
from scipy.sparse.linalg import SuperLU, splu
from scipy.special import chdtri

from ispom.geometry import Array, Pose, Similarity, skew, so3_exp, so3_log
from ispom.numerics.levenberg_marquardt import minimise

MAX_ITERATIONS, TOLERANCE = 20, 1e-9
"""Largest number of steps of one optimisation, and the relative decrease of the cost that ends it. From odometry with a
drift of some percent four steps are enough."""
FREEDOM = 7
"""Number of components of a measured relative pose with scale."""
OUTLIER, MEDIAN = float(chdtri(FREEDOM, 0.001)), float(chdtri(FREEDOM, 0.5))
"""Quantiles (99.9 % and 50 %) of the squared deviation of a correct measurement from the estimate of all others."""


@dataclass(frozen=True, eq=False)
class Edge:
    """A measured relative pose."""

    first: int
    then: int
    first_from_then: Similarity
    covariance: Array
    """(7, 7) covariance of its right perturbation (rho in then's frame and unit, phi [rad], ln scale)."""
    may_be_false: bool = False
    """Whether it may be an outlier, such as a loop closure between two similar scenes."""


@dataclass(frozen=True, eq=False)
class Spread:
    """An optimised graph."""

    nodes: tuple[Similarity, ...]
    covariance: Array
    """(7, 7) covariance of the last node's right perturbation."""
    cost: float
    """Half the sum of the squared normalised residuals of the inlier edges."""
    weights: Array
    """(E,) weights of the edges: 1, or 0 for outliers."""


def optimise(nodes: tuple[Similarity, ...], edges: tuple[Edge, ...], scaled: bool) -> Spread:
    """Returns the least-squares poses world_from_node; the first node is fixed.

    Edges that cannot be false must connect each node to the first one. `scaled`: scales may drift, else all are fixed.
    Edges that may be false are discarded one by one if they deviate from the estimate of all others (data snooping:
    Baarda 1968). Odometry drifts by more than its covariance, so deviations are relative to their median.
    """
    graph, weights = _Graph.of(edges, len(nodes), scaled), np.ones(len(edges))
    doubtful = np.array([e.may_be_false for e in edges])
    similarities = graph.adjusted(_Similarities.of(nodes), weights)
    while True:
        residuals, jacobian = graph.linearised(similarities, weights)
        factored, judged = graph.factored(jacobian), np.flatnonzero(doubtful & (weights > 0))
        deviations = np.array([_deviation(residuals, jacobian, factored, i) for i in judged.tolist()])
        if not len(judged) or not (deviations > OUTLIER * max(1.0, float(np.median(deviations)) / MEDIAN)).any():
            break
        weights[judged[np.argmax(deviations)]] = 0.0
        similarities = graph.adjusted(similarities, weights)
    last = np.zeros((graph.size, FREEDOM))
    last[-FREEDOM:] = np.eye(FREEDOM)
    covariance = factored.solve(last)[-FREEDOM:]
    if not scaled:
        # The scale is fixed; the one on its diagonal would propagate to a deviation as large as the path.
        covariance[-1, :] = covariance[:, -1] = 0.0
    return Spread(similarities.values(), (covariance + covariance.T) / 2, 0.5 * float(residuals @ residuals), weights)


def _deviation(residuals: Array, jacobian: csr_array, factored: SuperLU, edge: int) -> float:
    """Returns the squared deviation of an edge from the estimate of all others, in units of their joint covariance."""
    rows = slice(FREEDOM * edge, FREEDOM * (edge + 1))
    own, residual = jacobian[rows].toarray(), residuals[rows]
    return float(residual @ np.linalg.solve(np.eye(FREEDOM) - own @ factored.solve(own.T), residual))


def adjoint_sim3(between: Similarity) -> Array:
    """Returns the matrix (7, 7) that maps a right perturbation from before `between` to after it:
    M(d) @ b == b @ M(adjoint_sim3(b) @ d)."""
    return _adjoints(_Similarities.of((between,)))[0]


def joined(a: Edge, b: Edge) -> Edge:
    """Returns the composition of two consecutive edges."""
    way = adjoint_sim3(b.first_from_then)
    return Edge(a.first, b.then, a.first_from_then @ b.first_from_then, way @ a.covariance @ way.T + b.covariance)


def reversed_edge(edge: Edge) -> Edge:
    """Returns the inverse measurement, from `then` to `first`."""
    way = adjoint_sim3(edge.first_from_then.inverse())
    return Edge(edge.then, edge.first, edge.first_from_then.inverse(), way @ edge.covariance @ way.T)


@dataclass(frozen=True, eq=False)
class _Similarities:
    """N similarities as arrays (N,), (N, 3, 3), (N, 3)."""

    scales: Array
    rotations: Array
    translations: Array

    @staticmethod
    def of(values: tuple[Similarity, ...]) -> _Similarities:
        return _Similarities(
            np.array([v.scale for v in values]),
            np.stack([v.pose.rotation for v in values]),
            np.stack([v.pose.translation for v in values]),
        )

    def values(self) -> tuple[Similarity, ...]:
        every = zip(self.scales.tolist(), self.rotations, self.translations, strict=True)
        return tuple(Similarity(scale, Pose(turn, offset)) for scale, turn, offset in every)

    def at(self, index: NDArray[np.int64]) -> _Similarities:
        return _Similarities(self.scales[index], self.rotations[index], self.translations[index])

    def inverse(self) -> _Similarities:
        back = np.swapaxes(self.rotations, 1, 2)
        return _Similarities(1 / self.scales, back, -_times(back, self.translations) / self.scales[:, None])

    def __matmul__(self, other: _Similarities) -> _Similarities:
        translations = self.translations + self.scales[:, None] * _times(self.rotations, other.translations)
        return _Similarities(self.scales * other.scales, self.rotations @ other.rotations, translations)

    def moved(self, delta: Array) -> _Similarities:
        """Returns the similarities, perturbed on the right by (N, 7) rho, phi, ln scale."""
        return self @ _Similarities(np.exp(delta[:, 6]), so3_exp(delta[:, 3:6]), delta[:, :3])


@dataclass(frozen=True, eq=False)
class _Graph:
    first: NDArray[np.int64]
    then: NDArray[np.int64]
    measured: _Similarities
    roots: Array
    """(E, 7, 7) square roots of the edges' information."""
    size: int
    """Number of unknowns: 7 for each node but the first."""
    scaled: bool

    @staticmethod
    def of(edges: tuple[Edge, ...], nodes: int, scaled: bool) -> _Graph:
        return _Graph(
            np.array([e.first for e in edges], np.int64),
            np.array([e.then for e in edges], np.int64),
            _Similarities.of(tuple(e.first_from_then for e in edges)),
            np.linalg.inv(np.linalg.cholesky(np.stack([e.covariance for e in edges]))),
            FREEDOM * (nodes - 1),
            scaled,
        )

    def adjusted(self, start: _Similarities, weights: Array) -> _Similarities:
        """Returns the least-squares similarities, with weights (E,) of the edges."""

        def cost(similarities: _Similarities) -> float:
            return 0.5 * float(weights @ self.squares(similarities))

        def stepped(similarities: _Similarities, damping: float) -> _Similarities:
            residuals, jacobian = self.linearised(similarities, weights)
            delta = self.factored(jacobian, damping).solve(-(jacobian.T @ residuals)).reshape(-1, FREEDOM)
            return similarities.moved(np.concatenate([np.zeros((1, FREEDOM)), delta]))

        return minimise(start, cost, stepped, MAX_ITERATIONS, TOLERANCE).values

    def squares(self, nodes: _Similarities) -> Array:
        """Returns the squared normalised residuals (E,)."""
        return (_times(self.roots, self._residuals(nodes)[2]) ** 2).sum(axis=1)

    def _residuals(self, nodes: _Similarities) -> tuple[_Similarities, _Similarities, Array]:
        """Returns the relative poses, their differences from the measured ones, and these as vectors (E, 7)."""
        between = nodes.at(self.first).inverse() @ nodes.at(self.then)
        off = self.measured.inverse() @ between
        return between, off, np.column_stack([off.translations, so3_log(off.rotations), np.log(off.scales)])

    def linearised(self, nodes: _Similarities, weights: Array) -> tuple[Array, csr_array]:
        """Returns the normalised residuals (7 E,) and their Jacobian (7 E, size), times the square roots of weights."""
        between, off, residual = self._residuals(nodes)
        by_then = np.zeros((len(residual), FREEDOM, FREEDOM))
        by_then[:, :3, :3] = off.scales[:, None, None] * off.rotations
        turned = skew(residual[:, 3:6])
        # The inverse right Jacobian to the third order: residuals of verified edges are some degrees.
        by_then[:, 3:6, 3:6] = np.eye(3) + turned / 2 + turned @ turned / 12
        by_then[:, 6, 6] = float(self.scaled)
        blocks = np.concatenate([-by_then @ _adjoints(between), by_then], axis=2)
        if not self.scaled:
            blocks[:, :, FREEDOM - 1 :: FREEDOM] = 0.0
        roots = np.sqrt(weights)[:, None, None] * self.roots
        return _times(roots, residual).ravel(), self._sparse(roots @ blocks)

    def _sparse(self, blocks: Array) -> csr_array:
        """Returns the sparse matrix (7 E, size) of blocks (E, 7, 14) by `first` and `then`."""
        ends = np.stack([self.first, self.then], axis=1) - 1
        columns = (FREEDOM * ends[:, :, None] + np.arange(FREEDOM)).reshape(len(ends), 1, -1)
        rows = np.arange(FREEDOM * len(ends)).reshape(len(ends), FREEDOM, 1)
        rows, columns = (np.broadcast_to(index, blocks.shape) for index in (rows, columns))
        free = columns >= 0
        return coo_array((blocks[free], (rows[free], columns[free])), shape=(FREEDOM * len(ends), self.size)).tocsr()

    def factored(self, jacobian: csr_array, damping: float = 0.0) -> SuperLU:
        """Factors the normal equations, with the diagonal raised by the share `damping`; a one on it fixes scales."""
        held = np.zeros(self.size)
        held[FREEDOM - 1 :: FREEDOM] = float(not self.scaled)
        index = np.arange(self.size)
        normal = csc_array(jacobian.T @ jacobian)
        normal = normal + coo_array((held + damping * normal.diagonal(), (index, index)), shape=normal.shape)
        return splu(csc_array(normal), permc_spec="MMD_AT_PLUS_A")


def _adjoints(between: _Similarities) -> Array:
    """Returns the matrices (N, 7, 7) of `adjoint_sim3`."""
    back = np.swapaxes(between.rotations, 1, 2)
    by_scale = back / between.scales[:, None, None]
    out = np.zeros((len(back), FREEDOM, FREEDOM))
    out[:, :3, :3] = by_scale
    out[:, :3, 3:6] = -by_scale @ skew(between.translations)
    out[:, :3, 6] = _times(by_scale, between.translations)
    out[:, 3:6, 3:6] = back
    out[:, 6, 6] = 1.0
    return out


def _times(matrices: Array, vectors: Array) -> Array:
    """Returns the products (N, K) of matrices (N, K, K) and vectors (N, K)."""
    return (matrices @ vectors[:, :, None])[:, :, 0]
