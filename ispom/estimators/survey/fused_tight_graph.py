"""The factor graph of `fused.tight`: nodes with pose, velocity and biases, and the points that several of them see.

IMU and fixes are factors of gtsam; points are eliminated by `fused_points`. Both are summed to normal equations and
solved by Levenberg and Marquardt's method. A node that leaves takes with it what it and its tracks say about the
others: their joint information on the nodes that stay (Schur complement). Of tracks that go on, only the observation
in that node is given up: the others hold the window together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import csr_matrix, diags, eye, kron

from ispom.estimators.survey.fused_factors import BLIND, DIMENSIONS, LOSS, ORDER, SIZES, Factor, Factors
from ispom.estimators.survey.fused_graph import BIAS_PRIOR, GAUGE, SPEED_PRIOR, TILTED, UNPLACED_M, UNTURNED
from ispom.estimators.survey.fused_links import Link
from ispom.estimators.survey.fused_points import MOST_TRACKS, Sights
from ispom.estimators.survey.fused_tight_problem import Problem, solved
from ispom.estimators.survey.fused_values import NO_POINTS, Node, Noise
from ispom.geometry import Array, Pose
from ispom.types import LensCorrection, Rig

ITERATIONS = 8
CONVERGED = 1e-3
"""Iterations end where the cost, in variances, falls by less than this share."""
RELAXED = 1e-4
"""Information where nothing holds a parameter: 100 m, m/s or rad."""
STILL_M_S = 0.02
"""Standard deviation of the velocity of a rig that stands [m/s]."""


@dataclass(frozen=True, eq=False)
class TightPrior:
    """What is known of the nodes of the window by all that left it."""

    at: tuple[Node, ...]
    """Where it is linear."""
    information: Array
    """(K D, K D) of the K nodes."""
    vector: Array
    """(K D,) information times the most likely difference."""
    without: Mapping[str, Array]
    """(K D, K D) information without each sensor."""


@dataclass(frozen=True, eq=False)
class BoundedFactor(Factor):
    """A factor under Huber's loss: a fix that contradicts pulls on, with bounded force, and is not dropped. A graph
    without a visual scale that drops fixes never comes back."""

    def misfit(self, values: Any) -> float:
        """Returns the squared residual, in variances, without the loss."""
        cost = float(self.value.error(values))
        return 2 * cost if cost <= LOSS**2 / 2 else (cost / LOSS + LOSS / 2) ** 2


class TightGraph(Factors):
    """Estimates the nodes of a window with their points."""

    def __init__(self, rig: Rig, sensors: frozenset[str], camera_from_rig: Pose, noise_px: float) -> None:
        super().__init__(rig, sensors, camera_from_rig, Noise(0.0, 0.0, 0.0))
        self.letters = "xvb" if self.imu is not None else "x"
        self.starts = dict(zip(self.letters, np.cumsum([0, *(SIZES[c] for c in self.letters)]), strict=False))
        self.size = sum(SIZES[c] for c in self.letters)
        camera = rig.camera("video")
        self._sigma = noise_px / float(np.sqrt(camera.fx * camera.fy))
        self._body_from_camera = (camera_from_rig @ self.rig_from_body).inverse()
        self._to_camera = self._body_from_camera.inverse().adjoint[np.ix_(ORDER, ORDER)]

    def first_prior(self, node: Node, still: bool) -> TightPrior:
        """Returns the prior of a first node; `still`: the rig stands, so that its velocity is zero."""
        place, heading = (UNPLACED_M, UNTURNED) if "gnss" in self.sensors else (GAUGE, GAUGE)
        up = node.local_from_rig.rotation.T @ np.array([0.0, 0.0, 1.0])
        turn = TILTED**2 * np.eye(3) + (heading**2 - TILTED**2) * np.outer(up, up)
        return self.known_prior(node, np.asarray(block_diag(place**2 * np.eye(3), turn)), still)

    def known_prior(self, node: Node, covariance: Array, still: bool = False) -> TightPrior:
        """Returns the prior of a node, with the covariance (6, 6) of its twist."""
        along = self.rig_from_body.inverse().adjoint
        covariance = along @ covariance @ along.T
        speed = STILL_M_S if still else SPEED_PRIOR
        parts = {
            "x": np.linalg.inv(covariance[np.ix_(ORDER, ORDER)]),
            "v": np.eye(3) / speed**2,
            "b": np.diag(BIAS_PRIOR**-2.0),
        }
        information = np.asarray(block_diag(*(parts[c] for c in self.letters)), float)
        return TightPrior((node,), information, np.zeros(self.size), dict.fromkeys(sorted(self.sensors), information))

    def optimised(
        self, nodes: tuple[Node, ...], prior: TightPrior, lens: LensCorrection | None
    ) -> tuple[tuple[Node, ...], dict[str, float]]:
        """Returns the most likely nodes, and by sensor the RMS residual of its last factors [standard deviations]."""
        most = MOST_TRACKS * (1 + len(nodes) // 16)
        problem = Problem(self, nodes, prior, self._pairs(nodes), Sights(nodes, self._sigma, None, most, lens))
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
        misfits = dict[str, list[float]]()
        for factor in problem.factors:
            if factor.sensor in DIMENSIONS:
                misfits.setdefault(factor.sensor, []).append(factor.misfit(problem.values) / DIMENSIONS[factor.sensor])
        rms = {sensor: float(np.sqrt(np.mean(some[-6:]))) for sensor, some in misfits.items()}
        return found, {**({"visual": problem.visual_misfit} if len(problem.sights) else {}), **rms}

    def robust(self, covariance: Array) -> Any:
        import gtsam

        model = gtsam.noiseModel
        return model.Robust.Create(model.mEstimator.Huber.Create(LOSS), model.Gaussian.Covariance(covariance))

    def _pairs(self, nodes: tuple[Node, ...]) -> list[Factor]:
        """Returns the factors of all sensors but the images."""
        return [f for before, now in zip((None, *nodes), nodes, strict=False) for f in self._pair(before, now)]

    def _pair(self, before: Node | None, now: Node) -> list[Factor]:
        """Returns the factors from one node to the next, and those of the latter's fixes."""
        found = list[Factor]()
        if "gnss" in self.sensors:
            found += [BoundedFactor("gnss", self._fix(fix, now), now.number) for fix in now.fixes]
        if before is not None and self.imu is not None:
            found += self._inertial(before, now, self.imu, (now.time_ns - before.time_ns) * 1e-9)
        if before is not None and (self.imu is None or now.inertial is None):
            link = Link(before.local_from_rig.inverse() @ now.local_from_rig, BLIND)
            found.append(Factor("blind", self._relative(link, before.number, now.number, False), now.number, False))
        return found

    def reduced(
        self, nodes: tuple[Node, ...], prior: TightPrior, lens: LensCorrection | None
    ) -> tuple[TightPrior, tuple[Node, ...]]:
        """Returns the prior of the others once the first node leaves the window, and those others."""
        spent = np.setdiff1d(nodes[0].points.ids, nodes[-1].points.ids)
        factors = [*self._pair(None, nodes[0]), *self._pair(nodes[0], replace(nodes[1], fixes=()))]
        parts = Problem(self, nodes, prior, factors, Sights(nodes, self._sigma, spent, lens=lens)).parts()
        information, vector = _eliminated(*_sum(parts), self.size)
        without = dict[str, Array]()
        for sensor, start in prior.without.items():
            without[sensor] = _eliminated(*_sum(parts, (sensor, "prior"), start), self.size)[0]
        others = tuple(replace(n, points=n.points.without(spent)) for n in nodes[1:])
        at = tuple(replace(n, points=NO_POINTS) for n in others)
        return TightPrior(at, information, vector, without), others

    def uncertainty(
        self, nodes: tuple[Node, ...], prior: TightPrior, lens: LensCorrection | None
    ) -> tuple[Array, float, dict[str, float]]:
        """Returns of the last node the covariance (6, 6) of the rig's pose, the standard deviation of its velocity (0
        without an IMU) [m/s], and by sensor the factor by which its position would be less certain without it."""
        parts = Problem(self, nodes, prior, self._pairs(nodes), Sights(nodes, self._sigma, lens=lens)).parts()
        covariance, place = self._last(_sum(parts)[0]), slice(3, 6)
        own, gain = np.sqrt(np.trace(covariance[place, place])), dict[str, float]()
        for sensor, start in prior.without.items():
            other = self._last(_sum(parts, (sensor, "prior"), start)[0])
            gain[sensor] = float(np.sqrt(np.trace(other[place, place])) / own)
        along = self.rig_from_body.adjoint
        pose = along @ covariance[np.ix_(ORDER, ORDER)] @ along.T
        speed = np.sqrt(np.trace(covariance[6:9, 6:9]) / 3) if self.imu is not None else 0.0
        return 0.5 * (pose + pose.T), float(speed), gain

    def _last(self, information: Array) -> Array:
        """Returns the covariance (D, D) of the last node."""
        whole = information + RELAXED * np.eye(len(information))
        scale = 1 / np.sqrt(np.diag(whole))
        columns = np.eye(len(whole))[:, -self.size :]
        solved = np.linalg.solve(whole * np.outer(scale, scale), scale[:, None] * columns)
        return (scale[:, None] * solved)[-self.size :]

    def cameras(self, nodes: tuple[Node, ...], values: Any) -> tuple[Array, Array]:
        """Returns rotations (K, 3, 3) and places (K, 3) of the cameras."""
        import gtsam

        bodies = np.array([values.atPose3(gtsam.symbol("x", n.number)).matrix() for n in nodes])
        found = bodies @ self._body_from_camera.matrix
        return found[:, :3, :3], found[:, :3, 3]

    def spread(self, count: int) -> csr_matrix:
        """Returns (6 K, D K): twists of the cameras by changes of the nodes."""
        return csr_matrix(kron(eye(count), np.hstack([self._to_camera, np.zeros((6, self.size - 6))])))

    def difference(self, at: tuple[Node, ...], values: Any) -> Array:
        """Returns the change (K D,) of nodes from where they were."""
        import gtsam

        found = list[Array]()
        for node in at:
            then, key = self._parts(node), {c: gtsam.symbol(c, node.number) for c in self.letters}
            found.append(then["x"].localCoordinates(values.atPose3(key["x"])))
            if self.imu is not None:
                found.append(values.atVector(key["v"]) - then["v"])
                found.append(values.atConstantBias(key["b"]).vector() - then["b"].vector())
        return np.concatenate(found)


def _sum(
    parts: dict[str, tuple[Array, Array]], without: tuple[str, ...] = (), start: Array | None = None
) -> tuple[Array, Array]:
    """Returns information and vector of all parts but some, and of the first nodes what was known before."""
    whole = next(iter(parts.values()))
    information, vector = np.zeros_like(whole[0]), np.zeros_like(whole[1])
    if start is not None:
        information[: len(start), : len(start)] = start
    for sensor, (matrix, side) in parts.items():
        if sensor not in without:
            information += matrix
            vector += side
    return information, vector


def _eliminated(matrix: Array, vector: Array, size: int) -> tuple[Array, Array]:
    """Returns information and vector of what follows the first `size` parameters."""
    first = matrix[:size, :size] + RELAXED * np.eye(size)
    gain = np.linalg.solve(first, matrix[:size, size:]).T
    left = matrix[size:, size:] - gain @ matrix[:size, size:]
    return 0.5 * (left + left.T), vector[size:] - gain @ vector[:size]
