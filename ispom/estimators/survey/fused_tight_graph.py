"""The factor graph of `fused.tight`: nodes with pose, velocity and biases, and the points that several of them see.

IMU and fixes are factors of gtsam; `fused_points` eliminates points. Both are summed to normal equations and solved by
Levenberg and Marquardt's method. When a node leaves the window, the information of the node and its tracks on the
remaining nodes becomes a prior (Schur complement). Tracks that continue lose only their observation in that node,
because their other observations connect the nodes of the window.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import diags

from ispom.estimators.survey.fused_points import MOST_TRACKS, Sights
from ispom.estimators.survey.fused_tight_problem import Problem, solved
from ispom.estimators.survey.fused_values import Prior
from ispom.estimators.survey.fused_window import Uncertainty, WindowGraph
from ispom.geometry import Pose
from ispom.sensors.fusion import HUBER, NO_POINTS, Factor, Node
from ispom.types import LensCorrection, Rig

ITERATIONS = 8
CONVERGED = 1e-3
"""Iterations end where the cost, in variances, falls by less than this share."""
STILL_M_S = 0.02
"""Standard deviation of the velocity of a rig that stands [m/s]."""


class TightGraph(WindowGraph):
    """Estimates the nodes of a window with their points.

    Fixes have Huber's loss: a contradicting fix still acts, with a bounded weight, and is not dropped. A graph without
    a visual scale that drops fixes never recovers."""

    relaxed = 1e-4
    """100 m, m/s or rad."""

    def __init__(self, rig: Rig, sensors: frozenset[str], camera_from_rig: Pose, noise_px: float) -> None:
        super().__init__(rig, sensors, camera_from_rig, HUBER)
        camera = rig.camera("video")
        self._sigma = noise_px / float(np.sqrt(camera.fx * camera.fy))
        self._body_from_camera = (camera_from_rig @ self.rig_from_body).inverse()

    def optimised(
        self, nodes: tuple[Node, ...], prior: Prior, lens: LensCorrection | None
    ) -> tuple[tuple[Node, ...], dict[str, float]]:
        """Returns the most likely nodes, and by sensor the RMS residual of its last factors [standard deviations]."""
        most = MOST_TRACKS * (1 + len(nodes) // 16)
        problem = self._problem(nodes, prior, self._pairs(nodes), Sights(nodes, self._sigma, None, most, lens))
        damping, cost = 1e-5, problem.cost
        for _ in range(ITERATIONS):
            matrix, vector = problem.normal()
            trial = problem.moved(solved(matrix + damping * diags(matrix.diagonal()), vector))
            if trial.cost < cost:
                gain, cost, problem, damping = cost - trial.cost, trial.cost, trial, damping / 10
                if gain < CONVERGED * (1 + abs(cost)):
                    break
            else:
                damping *= 30
        found = tuple(self.node(node, problem.values) for node in nodes)
        misfits = self.misfits(problem.factors, problem.values)
        return found, {**({"visual": problem.visual_misfit} if len(problem.sights) else {}), **misfits}

    def _problem(self, nodes: tuple[Node, ...], prior: Prior, factors: list[Factor], sights: Sights) -> Problem:
        return Problem(self, self._body_from_camera, nodes, prior, factors, sights)

    def _pairs(self, nodes: tuple[Node, ...]) -> list[Factor]:
        """Returns the factors of all sensors but the images."""
        return [f for before, now in zip((None, *nodes), nodes, strict=False) for f in self._pair(before, now)]

    def _pair(self, before: Node | None, now: Node) -> list[Factor]:
        """Returns the factors from one node to the next, and those of the next node's fixes."""
        found = [*self.absolute_factors(before, now), *self.relative_factors(before, now)]
        if before is not None and not now.relative:
            found.append(self.blind_factor(before, now, before.local_from_rig.inverse() @ now.local_from_rig))
        return found

    def reduced(
        self, nodes: tuple[Node, ...], prior: Prior, lens: LensCorrection | None
    ) -> tuple[Prior, tuple[Node, ...]]:
        """Returns the prior of the others once the first node leaves the window, and those others."""
        spent = np.setdiff1d(nodes[0].points.ids, nodes[-1].points.ids)
        factors = [*self._pair(None, nodes[0]), *self._pair(nodes[0], nodes[1].without_absolute)]
        problem = self._problem(nodes, prior, factors, Sights(nodes, self._sigma, spent, lens=lens))
        information, vector, without = self.marginalised(problem.equations(), prior)
        others = tuple(replace(n, points=n.points.without(spent)) for n in nodes[1:])
        at = tuple(replace(n, points=NO_POINTS) for n in others)
        return Prior(at, information, vector, without), others

    def uncertainty(self, nodes: tuple[Node, ...], prior: Prior, lens: LensCorrection | None) -> Uncertainty:
        """Returns the uncertainty of the last node."""
        sights = Sights(nodes, self._sigma, lens=lens)
        return self.uncertainty_of(self._problem(nodes, prior, self._pairs(nodes), sights).equations(), prior)
