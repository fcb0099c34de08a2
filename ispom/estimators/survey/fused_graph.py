"""The factor graph of `fused`: a window of nodes, each with pose, velocity, biases and the scale of the images.

Built anew for each node with gtsam (Dellaert and Kaess, Factor Graphs for Robot Perception, 2017; preintegrated IMU:
Forster et al. 2017), from numbers only, so that a State is a value. What leaves the window stays as a prior: its
information on the next node (Schur complement). The same is kept once more without each sensor, which shows how much
that sensor contributes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from ispom.estimators.survey.fused_factors import DIMENSIONS, ORDER, SIZES, Factors
from ispom.estimators.survey.fused_influence import GraphProblem
from ispom.estimators.survey.fused_values import Node, Prior
from ispom.geometry import Array, Pose
from ispom.solvers.influence.problem import report_problem

ITERATIONS = 12
BIAS_PRIOR = np.array([0.3] * 3 + [0.02] * 3)
"""Standard deviations at the start: accelerometer [m/s^2], gyroscope [rad/s], of a calibrated MEMS unit."""
SPEED_PRIOR = 3.0
"""Standard deviation of the velocity at the start [m/s]."""
GAUGE = 1e-3
"""Standard deviation [m], [rad] of what the first pose defines."""
UNPLACED_M, UNTURNED, TILTED = 100.0, 0.5, 0.15
"""Standard deviations at the start: of a place and a heading by fixes [m], [rad], and of up by an IMU [rad]."""
RELAXED = 1e-9
"""Information added where nothing holds a parameter."""


class Graph(Factors):
    """Estimates the nodes of a window."""

    def first_covariance(self, first: Pose, tilt_deg: float) -> Array:
        """Returns the covariance (6, 6) of the first pose: the gauge, and what the start does not know well."""
        place, heading = (UNPLACED_M, UNTURNED) if "gnss" in self.sensors else (GAUGE, GAUGE)
        tilt = TILTED if "imu" in self.sensors else np.radians(tilt_deg) if "gnss" in self.sensors else GAUGE
        up = first.rotation.T @ np.array([0.0, 0.0, 1.0])
        turn = tilt**2 * np.eye(3) + (heading**2 - tilt**2) * np.outer(up, up)
        return np.asarray(block_diag(place**2 * np.eye(3), turn))

    def first_prior(self, node: Node, covariance: Array, scale_sigma: float) -> Prior:
        """Returns the prior of a first node, with the covariance (6, 6) of its twist."""
        along = self.rig_from_body.inverse().adjoint
        pose = np.linalg.inv((along @ covariance @ along.T)[np.ix_(ORDER, ORDER)])
        parts = {
            "x": pose,
            "v": np.eye(3) / SPEED_PRIOR**2,
            "b": np.diag(BIAS_PRIOR**-2.0),
            "s": np.eye(1) / scale_sigma**2,
        }
        information = np.asarray(block_diag(*(parts[c] for c in self.letters)), float)
        return Prior(node, information, np.zeros(self.size), dict.fromkeys(sorted(self.sensors), information))

    def optimised(self, nodes: tuple[Node, ...], prior: Prior) -> tuple[tuple[Node, ...], dict[str, float]]:
        """Returns the most likely nodes, and by sensor the RMS residual of its last factors [standard deviations]."""
        found, values = self.solved(nodes, prior, nodes)
        report_problem(lambda: GraphProblem(self, nodes, found, prior))
        misfits = dict[str, list[float]]()
        for f in self.factors(nodes, prior):
            if f.sensor in DIMENSIONS:
                misfits.setdefault(f.sensor, []).append(f.misfit(values) / DIMENSIONS[f.sensor])
        return found, {sensor: float(np.sqrt(np.mean(some[-6:]))) for sensor, some in misfits.items()}

    def solved(
        self, nodes: tuple[Node, ...], prior: Prior, start: tuple[Node, ...], without: str = ""
    ) -> tuple[tuple[Node, ...], Any]:
        """Returns the most likely nodes, and gtsam's values, from what was measured of `nodes`, beginning at `start`,
        without the factors of one sensor."""
        import gtsam

        graph = gtsam.NonlinearFactorGraph()
        for factor in self.factors(nodes, prior):
            if factor.sensor != without:
                graph.add(factor.value)
        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setMaxIterations(ITERATIONS)
        values = gtsam.LevenbergMarquardtOptimizer(graph, self.values(start), parameters).optimize()
        return tuple(self.node(node, values) for node in start), values

    def reduced(self, nodes: tuple[Node, ...], prior: Prior) -> Prior:
        """Returns the prior of the second node once the first one leaves the window."""
        (step,) = self._linear((nodes[0], replace(nodes[1], fixes=())), prior)
        information, vector = _eliminated(prior.information * 0, prior.vector * 0, *_sum(step))
        without = {
            s: _eliminated(w, None, _sum(step, without=(s, "prior"))[0], None)[0] for s, w in prior.without.items()
        }
        return Prior(nodes[1], information, vector, without)

    def uncertainty(self, nodes: tuple[Node, ...], prior: Prior) -> tuple[Array, float, dict[str, float]]:
        """Returns of the last node the covariance (6, 6) of the rig's pose, the standard deviation of the log scale,
        and by sensor the factor by which the position would be less certain without it."""
        steps = self._linear(nodes, prior)
        alone = np.zeros((self.size, self.size)) if steps else prior.information
        covariance = np.linalg.inv(self._last(alone, steps, ()) + RELAXED * np.eye(self.size))
        place, s = slice(3, 6), self.starts["s"]
        own = np.sqrt(np.trace(covariance[place, place]))
        gain = dict[str, float]()
        for sensor, start in prior.without.items():
            other = np.linalg.inv(self._last(start, steps, (sensor, "prior")) + RELAXED * np.eye(self.size))
            gain[sensor] = float(np.sqrt(np.trace(other[place, place])) / own)
        along = self.rig_from_body.adjoint
        pose = along @ covariance[np.ix_(ORDER, ORDER)] @ along.T
        return 0.5 * (pose + pose.T), float(np.sqrt(covariance[s, s])), gain

    def _last(self, start: Array, steps: list[dict[str, tuple[Array, Array]]], without: tuple[str, ...]) -> Array:
        for step in steps:
            start, _ = _eliminated(start, None, _sum(step, without)[0], None)
        return start

    def _linear(self, nodes: tuple[Node, ...], prior: Prior) -> list[dict[str, tuple[Array, Array]]]:
        """Returns for each pair of consecutive nodes, by sensor, the information (2 D, 2 D) and the vector (2 D,)."""
        if len(nodes) < 2:
            return []
        values, size = self.values(nodes), self.size
        number = {node.number: i for i, node in enumerate(nodes)}
        steps: list[dict[str, tuple[Array, Array]]] = [{} for _ in nodes[1:]]
        for factor in self.factors(nodes, prior):
            linear = factor.value.linearize(values)
            rows, side = linear.jacobian()
            pair = max(number[factor.to] - 1, 0)
            wide, at = np.zeros((len(side), 2 * size)), 0
            for key in linear.keys():  # noqa: SIM118 (a method of gtsam)
                letter, index = chr(key >> 56), number[key & ((1 << 56) - 1)]
                begin = (index - pair) * size + self.starts[letter]
                wide[:, begin : begin + SIZES[letter]] = rows[:, at : at + SIZES[letter]]
                at += SIZES[letter]
            information, vector = steps[pair].get(factor.sensor, (0.0, 0.0))
            steps[pair][factor.sensor] = (information + wide.T @ wide, vector + wide.T @ side)
        return steps


def _sum(step: dict[str, tuple[Array, Array]], without: tuple[str, ...] = ()) -> tuple[Array, Array]:
    kept = [value for sensor, value in step.items() if sensor not in without]
    return sum(h for h, _ in kept), sum(g for _, g in kept)  # type: ignore[return-value]


def _eliminated(start: Array, start_vector: Array | None, pair: Array, vector: Array | None) -> tuple[Array, Array]:
    """Returns information and vector of the second node of a pair, with those known of the first one."""
    size = len(start)
    first = pair[:size, :size] + start + RELAXED * np.eye(size)
    gain = np.linalg.solve(first, pair[:size, size:]).T
    left = pair[size:, size:] - gain @ pair[:size, size:]
    side = np.zeros(size)
    if vector is not None and start_vector is not None:
        side = vector[size:] - gain @ (vector[:size] + start_vector)
    return 0.5 * (left + left.T), side
