"""The window of `fused.tight` about one estimate: its cost, its normal equations, and the same after a step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix, diags, eye
from scipy.sparse.linalg import spsolve

from ispom.estimators.survey.fused_factors import SIZES, Factor
from ispom.estimators.survey.fused_points import Sights
from ispom.estimators.survey.fused_values import Node
from ispom.geometry import Array

if TYPE_CHECKING:
    from ispom.estimators.survey.fused_tight_graph import TightGraph, TightPrior

SPARSE_FROM = 600
"""Unknowns from which on normal equations are solved as sparse ones."""
LEAST = 1e-4
"""Added to the diagonal: nothing is known better than by 100 m, m/s or rad where nothing holds it."""


class Problem:
    """The window about one estimate."""

    def __init__(
        self,
        graph: TightGraph,
        nodes: tuple[Node, ...],
        prior: TightPrior,
        factors: list[Factor],
        sights: Sights,
        values: Any = None,
        points: Array | None = None,
    ) -> None:
        self._graph, self._nodes, self._prior, self.factors, self.sights = graph, nodes, prior, factors, sights
        self.values = graph.values(nodes) if values is None else values
        cameras = graph.cameras(nodes, self.values)
        self._points = sights.placed(*cameras, sights.start, 6) if points is None else sights.placed(*cameras, points)
        self._linear = sights.linear(*cameras, self._points)
        place = {node.number: i for i, node in enumerate(nodes)}
        self._of_prior = np.concatenate([graph.size * place[n.number] + np.arange(graph.size) for n in prior.at])
        self._place, self._gap = place, graph.difference(prior.at, self.values)
        known = 0.5 * self._gap @ prior.information @ self._gap - prior.vector @ self._gap
        measured = sum(float(f.value.error(self.values)) for f in factors)
        self.cost = float(known + measured + sights.cost(self._linear, self._points))

    @property
    def visual_misfit(self) -> float:
        """RMS residual of the observations of the last node's tracks [standard deviations], outliers by their loss."""
        lasting = np.isin(self.sights.ids, self.sights.ids[self.sights.track[self.sights.view == len(self._nodes) - 1]])
        of = lasting[self.sights.track]
        if not of.any():
            return 0.0
        squared = (self._linear.weights * (self._linear.residuals**2).sum(axis=1))[of].sum()
        return float(np.sqrt(squared / max(2 * of.sum() - 3 * lasting.sum(), 1)))

    def moved(self, change: Array) -> Problem:
        """Returns the same about another estimate."""
        import gtsam

        step, size = gtsam.VectorValues(), self._graph.size
        for node in self._nodes:
            for letter in self._graph.letters:
                begin = size * self._place[node.number] + int(self._graph.starts[letter])
                step.insert(gtsam.symbol(letter, node.number), change[begin : begin + SIZES[letter]])
        values = self.values.retract(step)
        return Problem(self._graph, self._nodes, self._prior, self.factors, self.sights, values, self._points)

    def normal(self) -> tuple[csr_matrix, Array]:
        """Returns the normal equations of all nodes."""
        parts = self.sparse_parts()
        matrix, vector = csr_matrix(self._shape), np.zeros(self._shape[0])
        for other, side in parts.values():
            matrix, vector = matrix + other, vector + side
        return matrix, vector

    @property
    def _shape(self) -> tuple[int, int]:
        unknowns = self._graph.size * len(self._nodes)
        return unknowns, unknowns

    def parts(self) -> dict[str, tuple[Array, Array]]:
        """Returns by sensor the information (K D, K D) and the vector (K D,) of all nodes."""
        return {sensor: (matrix.toarray(), vector) for sensor, (matrix, vector) in self.sparse_parts().items()}

    def sparse_parts(self) -> dict[str, tuple[csr_matrix, Array]]:
        """Returns the same with sparse matrices."""
        collected = dict[str, tuple[list[Any], list[Any], list[Any], Array]]()
        starts = self._graph.starts
        for factor in self.factors:
            linear = factor.value.linearize(self.values)
            index = np.concatenate(
                [
                    self._graph.size * self._place[key & ((1 << 56) - 1)]
                    + int(starts[chr(key >> 56)])
                    + np.arange(SIZES[chr(key >> 56)])
                    for key in linear.keys()  # noqa: SIM118 (a method of gtsam)
                ]
            )
            whole = linear.augmentedInformation()
            empty = list[Any](), list[Any](), list[Any](), np.zeros(self._shape[0])
            values, rows, columns, vector = collected.setdefault(factor.sensor, empty)
            values.append(whole[:-1, :-1].ravel())
            rows.append(np.repeat(index, len(index)))
            columns.append(np.tile(index, len(index)))
            vector[index] += whole[:-1, -1]
        found = {
            sensor: (csr_matrix((np.concatenate(v), (np.concatenate(r), np.concatenate(c))), self._shape), vector)
            for sensor, (v, r, c, vector) in collected.items()
        }
        side = np.zeros(self._shape[0])
        side[self._of_prior] = self._prior.vector - self._prior.information @ self._gap
        index = self._of_prior
        at = np.repeat(index, len(index)), np.tile(index, len(index))
        found["prior"] = csr_matrix((self._prior.information.ravel(), at), self._shape), side
        if len(self.sights):
            spread = self._graph.spread(len(self._nodes))
            matrix, vector = self.sights.reduced(self._linear, self._points, len(self._nodes))
            found["visual"] = csr_matrix(spread.T @ matrix @ spread), spread.T @ vector
        return found


def solved(matrix: csr_matrix, vector: Array) -> Array:
    """Solves normal equations, scaled to a diagonal of 1."""
    scale = 1 / np.sqrt(matrix.diagonal() + LEAST)
    scaled = csc_matrix(diags(scale) @ matrix @ diags(scale) + 1e-12 * eye(len(scale)))
    if len(vector) < SPARSE_FROM:
        return scale * np.linalg.solve(scaled.toarray(), scale * vector)
    return scale * spsolve(scaled, scale * vector)
