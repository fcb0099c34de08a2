"""The window of `fused.tight` about one estimate: its cost, its normal equations, and the same after a step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix, diags, eye, kron
from scipy.sparse.linalg import spsolve

from ispom.estimators.survey.fused_points import Sights
from ispom.estimators.survey.fused_values import Prior
from ispom.estimators.survey.fused_window import WindowGraph
from ispom.geometry import Array, Pose
from ispom.sensors.fusion import ORDER, POSE, Factor, Node

if TYPE_CHECKING:
    import gtsam

SPARSE_FROM = 600
"""Unknowns from which on normal equations are solved as sparse ones."""
LEAST = 1e-4
"""Added to the diagonal: nothing is known better than by 100 m, m/s or rad where nothing holds it."""


class Problem:
    """The window about one estimate."""

    def __init__(
        self,
        graph: WindowGraph,
        body_from_camera: Pose,
        nodes: tuple[Node, ...],
        prior: Prior,
        factors: list[Factor],
        sights: Sights,
        values: gtsam.Values | None = None,
        points: Array | None = None,
    ) -> None:
        self._graph, self._nodes, self._prior, self.factors, self.sights = graph, nodes, prior, factors, sights
        self.values = graph.values(nodes) if values is None else values
        self._body_from_camera = body_from_camera
        cameras = self._cameras()
        self._points = sights.placed(*cameras, sights.start, 6) if points is None else sights.placed(*cameras, points)
        self._linear = sights.linear(*cameras, self._points)
        place = {node.number: i for i, node in enumerate(nodes)}
        self._of_prior = np.concatenate([graph.size * place[n.number] + np.arange(graph.size) for n in prior.at])
        self._place, self._gap = place, graph.change_from(prior.at)(self.values)
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
            for each in self._graph.variables:
                begin = size * self._place[node.number] + int(self._graph.starts[each.letter])
                step.insert(each.key(node), change[begin : begin + each.size])
        values = self.values.retract(step)
        return Problem(
            self._graph,
            self._body_from_camera,
            self._nodes,
            self._prior,
            self.factors,
            self.sights,
            values,
            self._points,
        )

    def normal(self) -> tuple[csr_matrix, Array]:
        """Returns the normal equations of all nodes."""
        unknowns = self._graph.size * len(self._nodes)
        matrix, vector = csr_matrix((unknowns, unknowns)), np.zeros(unknowns)
        for other, side in self.equations().values():
            matrix, vector = matrix + other, vector + side
        return matrix, vector

    def equations(self) -> dict[str, tuple[csr_matrix, Array]]:
        """Returns by sensor, the images and the prior too, the information (K D, K D) and the vector (K D,)."""
        found = self._graph.equations(self.factors, self.values, self._nodes)
        unknowns = self._graph.size * len(self._nodes)
        side = np.zeros(unknowns)
        side[self._of_prior] = self._prior.vector - self._prior.information @ self._gap
        index = self._of_prior
        at = np.repeat(index, len(index)), np.tile(index, len(index))
        found["prior"] = csr_matrix((self._prior.information.ravel(), at), (unknowns, unknowns)), side
        if len(self.sights):
            spread = self._camera_twists()
            matrix, vector = self.sights.reduced(self._linear, self._points, len(self._nodes))
            found["visual"] = csr_matrix(spread.T @ matrix @ spread), spread.T @ vector
        return found

    def _cameras(self) -> tuple[Array, Array]:
        """Returns rotations (K, 3, 3) and places (K, 3) of the cameras."""
        bodies = np.array([self.values.atPose3(POSE.key(node)).matrix() for node in self._nodes])
        found = bodies @ self._body_from_camera.matrix
        return found[:, :3, :3], found[:, :3, 3]

    def _camera_twists(self) -> csr_matrix:
        """Returns (6 K, D K): twists of the cameras by changes of the nodes."""
        to_camera = self._body_from_camera.inverse().adjoint[np.ix_(ORDER, ORDER)]
        unseen = np.zeros((6, self._graph.size - 6))
        return csr_matrix(kron(eye(len(self._nodes)), np.hstack([to_camera, unseen])))


def solved(matrix: csr_matrix, vector: Array) -> Array:
    """Solves normal equations, scaled to a diagonal of 1."""
    scale = 1 / np.sqrt(matrix.diagonal() + LEAST)
    scaled = csc_matrix(diags(scale) @ matrix @ diags(scale) + 1e-12 * eye(len(scale)))
    if len(vector) < SPARSE_FROM:
        return scale * np.linalg.solve(scaled.toarray(), scale * vector)
    return scale * spsolve(scaled, scale * vector)
