"""The factor graph of `fused`: a window of nodes, each with pose, velocity, biases and the scale of the images.

The images enter by relative poses (loose coupling) with a scale that changes slowly, the other sensors by the factors
of their kinds (`ispom.sensors`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ispom.estimators.survey.fused_values import Prior
from ispom.estimators.survey.fused_window import Uncertainty, WindowGraph
from ispom.geometry import Pose, skew, so3_log
from ispom.sensors.fusion import CAUCHY, ORDER, POSE, SCALE, Factor, MotionNoise, Node
from ispom.types import Rig

if TYPE_CHECKING:
    import gtsam

ITERATIONS = 12
FRESH = 1.0
"""Standard deviation of the change of the log scale where the world of the images is a new one."""


@dataclass(frozen=True, eq=False)
class Optimum:
    """The most likely nodes of a window."""

    nodes: tuple[Node, ...]
    values: gtsam.Values
    """The estimates in gtsam's form."""
    factors: list[Factor]


class Graph(WindowGraph):
    """Estimates the nodes of a window."""

    relaxed = 1e-9

    def __init__(self, rig: Rig, sensors: frozenset[str], camera_from_rig: Pose, noise: MotionNoise) -> None:
        super().__init__(rig, sensors, camera_from_rig, CAUCHY, (SCALE,))
        self.noise = noise
        """Noise of images that do not state their own."""

    def optimised(self, nodes: tuple[Node, ...], prior: Prior) -> tuple[tuple[Node, ...], dict[str, float]]:
        """Returns the most likely nodes, and by sensor the RMS residual of its last factors [standard deviations]."""
        found = self.solved(nodes, prior, nodes)
        return found.nodes, self.misfits(found.factors, found.values)

    def solved(self, nodes: tuple[Node, ...], prior: Prior, start: tuple[Node, ...], without: str = "") -> Optimum:
        """Returns the most likely nodes by the measurements of `nodes`, starting from the estimates `start`. The
        factors of the sensor `without` are skipped."""
        import gtsam

        graph, factors = gtsam.NonlinearFactorGraph(), self.factors(nodes, prior)
        for factor in factors:
            if factor.sensor != without:
                graph.add(factor.value)
        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setMaxIterations(ITERATIONS)
        values = gtsam.LevenbergMarquardtOptimizer(graph, self.values(start), parameters).optimize()
        return Optimum(tuple(self.node(node, values) for node in start), values, factors)

    def reduced(self, nodes: tuple[Node, ...], prior: Prior) -> Prior:
        """Returns the prior of the second node once the first one leaves the window."""
        pair = (nodes[0], nodes[1].without_absolute)
        equations = self.equations(self.factors(pair, prior), self.values(pair), pair)
        return Prior((nodes[1],), *self.marginalised(equations, prior))

    def uncertainty(self, nodes: tuple[Node, ...], prior: Prior) -> Uncertainty:
        """Returns the uncertainty of the last node."""
        return self.uncertainty_of(self.equations(self.factors(nodes, prior), self.values(nodes), nodes), prior)

    def factors(self, nodes: tuple[Node, ...], prior: Prior) -> list[Factor]:
        """Returns all factors of a window."""
        found = [self._prior_factor(prior), *self.absolute_factors(None, nodes[0])]
        for before, now in pairwise(nodes):
            found += self.absolute_factors(before, now)
            found.append(self._scale_factor(before, now))
            if now.visual is not None:
                found.append(self._visual_factor(now.visual, before, now))
            found += self.relative_factors(before, now)
            if not now.motion_sources:
                found.append(self.blind_factor(before, now, Pose()))
        return found

    def _scale_factor(self, before: Node, now: Node) -> Factor:
        import gtsam

        seconds = (now.time_ns - before.time_ns) * 1e-9
        walk = FRESH if now.fresh else (now.noise or self.noise).scale_walk * np.sqrt(seconds)
        noise, keys = gtsam.noiseModel.Isotropic.Sigma(1, walk), (SCALE.key(before), SCALE.key(now))
        return Factor("scale", gtsam.BetweenFactorVector(*keys, np.zeros(1), noise), now.number)

    def _visual_factor(self, moved: Pose, before: Node, now: Node) -> Factor:
        """Residuals: the rotation, and the translation [m] less that of the images times the scale at the node."""
        import gtsam

        body_from_camera = self.rig_from_body.inverse() @ self.frames.camera_from_rig.inverse()
        to_camera = body_from_camera.inverse().adjoint[np.ix_(ORDER, ORDER)]
        keys = [POSE.key(before), POSE.key(now), SCALE.key(now)]
        scale, seconds = float(np.exp(now.log_scale)), (now.time_ns - before.time_ns) * 1e-9
        covariance = (now.noise or self.noise).covariance(moved, scale, seconds)[np.ix_(ORDER, ORDER)]

        def error(_: gtsam.CustomFactor, values: gtsam.Values, jacobians: Any) -> Any:
            first, second = (Pose.from_matrix(values.atPose3(key).matrix()) @ body_from_camera for key in keys[:2])
            estimate, scale = first.inverse() @ second, np.exp(values.atVector(keys[2])[0])
            if jacobians is not None:
                by_first, by_second = np.zeros((6, 6)), np.zeros((6, 6))
                by_first[:3, :3], by_second[:3, :3] = -estimate.rotation.T, np.eye(3)
                by_first[3:, :3], by_first[3:, 3:] = skew(estimate.translation), -np.eye(3)
                by_second[3:, 3:] = estimate.rotation
                jacobians[0], jacobians[1] = by_first @ to_camera, by_second @ to_camera
                jacobians[2] = np.concatenate([np.zeros(3), -scale * moved.translation])[:, None]
            turn = so3_log(moved.rotation.T @ estimate.rotation)
            return np.concatenate([turn, estimate.translation - scale * moved.translation])

        factor = gtsam.CustomFactor(CAUCHY.noise(covariance), keys, error)
        return Factor("visual", factor, now.number, 6, CAUCHY)

    def _prior_factor(self, prior: Prior) -> Factor:
        import gtsam

        sizes, turned = np.linalg.eigh(prior.information)
        known = sizes > 1e-12 * sizes[-1]
        root = np.sqrt(sizes[known])[:, None] * turned[:, known].T
        side = turned[:, known].T @ prior.vector / np.sqrt(sizes[known])
        keys, change = [each.key(prior.at[0]) for each in self.variables], self.change_from(prior.at)

        def error(_: gtsam.CustomFactor, values: gtsam.Values, jacobians: Any) -> Any:
            if jacobians is not None:
                for n, each in enumerate(self.variables):
                    begin = int(self.starts[each.letter])
                    jacobians[n] = root[:, begin : begin + each.size]
            return root @ change(values) - side

        noise = gtsam.noiseModel.Unit.Create(int(known.sum()))
        return Factor("prior", gtsam.CustomFactor(noise, keys, error), prior.at[0].number)
