"""The common part of the graphs of `fused` and `fused.tight`: unknowns of a window, prior, and uncertainty.

A graph is built again for each node with gtsam (Dellaert and Kaess, Factor Graphs for Robot Perception, 2017), from
numbers only, so that a State is a value. The information of nodes that leave the window on the remaining nodes stays as
a prior (Schur complement). A further prior without each sensor shows how much that sensor contributes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import csr_matrix

from ispom.estimators.survey.fused_values import Prior
from ispom.geometry import Array, Pose
from ispom.sensors import SENSOR_KINDS
from ispom.sensors.fusion import ORDER, POSE, Factor, GraphFrames, Link, Loss, Node, Variable, sensor_of
from ispom.types import Imu, Rig

if TYPE_CHECKING:
    import gtsam

GAUGE = 1e-5
"""Standard deviation [m], [rad] of the first pose, which defines the world: it only keeps equations solvable."""
UNPLACED_M, UNTURNED, TILTED = 100.0, 0.5, 0.15
"""Standard deviations at the start: of a place and a heading by fixes [m], [rad], and of up by an IMU [rad]."""
BLIND = np.diag([50.0, 50.0, 50.0, 0.5, 0.5, 0.5]) ** 2
"""Covariance of a motion that nothing measured."""
LAST_FACTORS = 6
"""Number of the last factors of a sensor from which its misfit is computed."""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """The uncertainty of the last node of a window."""

    covariance: Array
    """(6, 6) of the rig's pose."""
    by_letter: Mapping[str, float]
    """Standard deviation (root mean square) of each of its unknowns."""
    gains: Mapping[str, float]
    """By sensor, the factor by which the position would be less certain without it."""
    unknowns: Mapping[str, Array]
    """Covariance of each of its unknowns, by letter; that of the pose as gtsam has it."""


class WindowGraph:
    """The unknowns of the nodes of a window, with their factors and prior."""

    relaxed: float
    """Information added where nothing holds a parameter."""

    def __init__(
        self, rig: Rig, sensors: frozenset[str], camera_from_rig: Pose, loss: Loss, scale: tuple[Variable, ...] = ()
    ) -> None:
        self.sensors, self.kinds = sensors, [k for name, k in SENSOR_KINDS.items().items() if name in sensors]
        imu: Imu | None = sensor_of(rig, Imu) if "imu" in sensors else None
        self.has_imu = imu is not None
        self.rig_from_body = Pose() if imu is None else imu.rig_from_sensor
        self.frames = GraphFrames(rig, camera_from_rig, self.rig_from_body, loss)
        of_sensors = [(kind.name == "imu", each) for kind in self.kinds for each in kind.variables]
        first, others = ([each for is_imu, each in of_sensors if is_imu is wanted] for wanted in (True, False))
        self.variables: tuple[Variable, ...] = (POSE, *first, *scale, *others)
        self.starts = dict(
            zip((v.letter for v in self.variables), np.cumsum([0, *(v.size for v in self.variables)]), strict=False)
        )
        if len(self.starts) < len(self.variables):
            raise ValueError(f"two unknowns have one letter: {[v.letter for v in self.variables]}")
        self.size = sum(v.size for v in self.variables)

    # Nodes as gtsam has them.

    def values(self, nodes: tuple[Node, ...]) -> gtsam.Values:
        """Returns the estimates of nodes."""
        import gtsam

        values = gtsam.Values()
        for node in nodes:
            for each in self.variables:
                values.insert(each.key(node), each.of(node, self.rig_from_body))
        return values

    def node(self, node: Node, values: gtsam.Values) -> Node:
        """Returns a node with the estimates of gtsam."""
        for each in self.variables:
            node = each.put(node, each.at(values, each.key(node)), self.rig_from_body)
        return node

    def change_from(self, nodes: tuple[Node, ...]) -> Callable[[gtsam.Values], Array]:
        """Returns a function that gives the change (K D,) of K nodes from their estimates to other values."""
        known = [(v, v.key(node), v.of(node, self.rig_from_body)) for node in nodes for v in self.variables]
        return lambda values: np.concatenate([v.difference(then, v.at(values, key)) for v, key, then in known])

    # Factors.

    def absolute_factors(self, before: Node | None, now: Node) -> list[Factor]:
        """Returns the factors of observations at a node."""
        return self._sensor_factors("absolute", before, now)

    def relative_factors(self, before: Node | None, now: Node) -> list[Factor]:
        """Returns the factors of observations of the motion to a node. Factors with additional unknowns come last."""
        return self._sensor_factors("relative", before, now)

    def _sensor_factors(self, measures: str, before: Node | None, now: Node) -> list[Factor]:
        kinds = sorted((k for k in self.kinds if k.measures == measures), key=lambda kind: bool(kind.variables))
        return [factor for kind in kinds for factor in kind.factors(before, now, self.frames)]

    def blind_factor(self, before: Node, now: Node, moved: Pose) -> Factor:
        """Returns the factor of a motion that nothing measured."""
        return self.frames.relative_pose("blind", Link(moved, BLIND), before, now, loss=None)

    def misfits(self, factors: list[Factor], values: gtsam.Values) -> dict[str, float]:
        """Returns by sensor the RMS residual of its last factors [standard deviations]."""
        squares = dict[str, list[float]]()
        for factor in factors:
            if factor.dimensions:
                squares.setdefault(factor.sensor, []).append(factor.squared(values) / factor.dimensions)
        return {sensor: float(np.sqrt(np.mean(some[-LAST_FACTORS:]))) for sensor, some in squares.items()}

    # The prior.

    def first_covariance(self, first: Pose, tilt_rad: float) -> Array:
        """Returns the covariance (6, 6) of the first pose: that of the gauge, and that of the start.

        `tilt_rad`: standard deviation of up, of a rig without an IMU."""
        place, heading = (UNPLACED_M, UNTURNED) if "gnss" in self.sensors else (GAUGE, GAUGE)
        tilt = TILTED if self.has_imu else tilt_rad if "gnss" in self.sensors else GAUGE
        up = first.rotation.T @ np.array([0.0, 0.0, 1.0])
        turn = tilt**2 * np.eye(3) + (heading**2 - tilt**2) * np.outer(up, up)
        return np.asarray(block_diag(place**2 * np.eye(3), turn))

    def first_prior(self, node: Node, covariance: Array, **sigmas: float) -> Prior:
        """Returns the prior of a first node, with the covariance (6, 6) of its twist, and the standard deviations of
        other unknowns than usual, by their letters."""
        along = self.rig_from_body.inverse().adjoint
        parts = [np.linalg.inv((along @ covariance @ along.T)[np.ix_(ORDER, ORDER)])]
        for each in self.variables[1:]:
            sigma = sigmas.get(each.letter)
            parts.append(each.first_information() if sigma is None else np.eye(each.size) / sigma**2)
        information = np.asarray(block_diag(*parts), float)
        return Prior((node,), information, np.zeros(self.size), dict.fromkeys(sorted(self.sensors), information))

    # Normal equations, by sensor.

    def equations(
        self, factors: list[Factor], values: gtsam.Values, nodes: tuple[Node, ...]
    ) -> dict[str, tuple[csr_matrix, Array]]:
        """Returns by sensor the information (K D, K D) and the vector (K D,) of K nodes."""
        place, unknowns = {node.number: i for i, node in enumerate(nodes)}, self.size * len(nodes)
        sizes = {each.letter: each.size for each in self.variables}
        collected = dict[str, tuple[list[Any], list[Any], list[Any], Array]]()
        for factor in factors:
            linear = factor.value.linearize(values)
            index = np.concatenate(
                [
                    self.size * place[key & ((1 << 56) - 1)]
                    + int(self.starts[chr(key >> 56)])
                    + np.arange(sizes[chr(key >> 56)])
                    for key in linear.keys()  # noqa: SIM118 (a method of gtsam)
                ]
            )
            derivatives, side = linear.jacobian()
            empty = list[Any](), list[Any](), list[Any](), np.zeros(unknowns)
            entries, rows, columns, vector = collected.setdefault(factor.sensor, empty)
            entries.append((derivatives.T @ derivatives).ravel())
            rows.append(np.repeat(index, len(index)))
            columns.append(np.tile(index, len(index)))
            vector[index] += derivatives.T @ side
        shape = unknowns, unknowns
        return {
            sensor: (csr_matrix((np.concatenate(v), (np.concatenate(r), np.concatenate(c))), shape), vector)
            for sensor, (v, r, c, vector) in collected.items()
        }

    def marginalised(
        self, equations: Mapping[str, tuple[csr_matrix, Array]], prior: Prior
    ) -> tuple[Array, Array, dict[str, Array]]:
        """Returns information and vector of the nodes after the first one, and the information without each sensor."""
        information, vector = self._without_first(*_total(equations))
        without = {
            sensor: self._without_first(*_total(equations, sensor, known))[0] for sensor, known in prior.without.items()
        }
        return information, vector, without

    def _without_first(self, matrix: Array, vector: Array) -> tuple[Array, Array]:
        size = self.size
        first = matrix[:size, :size] + self.relaxed * np.eye(size)
        gain = np.linalg.solve(first, matrix[:size, size:]).T
        left = matrix[size:, size:] - gain @ matrix[:size, size:]
        return 0.5 * (left + left.T), vector[size:] - gain @ vector[:size]

    def uncertainty_of(self, equations: Mapping[str, tuple[csr_matrix, Array]], prior: Prior) -> Uncertainty:
        """Returns the uncertainty of the last node."""
        covariance, place = self._last(_total(equations)[0]), slice(3, 6)
        own, gains = np.sqrt(np.trace(covariance[place, place])), dict[str, float]()
        for sensor, known in prior.without.items():
            other = self._last(_total(equations, sensor, known)[0])
            gains[sensor] = float(np.sqrt(np.trace(other[place, place])) / own)
        along = self.rig_from_body.adjoint
        pose = along @ covariance[np.ix_(ORDER, ORDER)] @ along.T
        variances, sigmas, unknowns = np.diag(covariance), dict[str, float](), dict[str, Array]()
        for each in self.variables:
            begin = int(self.starts[each.letter])
            part = slice(begin, begin + each.size)
            sigmas[each.letter] = float(np.sqrt(variances[part].mean()))
            unknowns[each.letter] = covariance[part, part]
        return Uncertainty(0.5 * (pose + pose.T), sigmas, gains, unknowns)

    def _last(self, information: Array) -> Array:
        """Returns the covariance (D, D) of the last node: those before it are eliminated one by one, and change only
        the unknowns that they share a factor with."""
        size, left = self.size, information + self.relaxed * np.eye(len(information))
        while len(left) > size:
            shared = size + np.flatnonzero(left[:size, size:].any(axis=0))
            across = left[:size, shared]
            left[np.ix_(shared, shared)] -= across.T @ np.linalg.solve(left[:size, :size], across)
            left = left[size:, size:]
        return np.linalg.inv(left)


def _total(
    equations: Mapping[str, tuple[csr_matrix, Array]], without: str = "", known: Array | None = None
) -> tuple[Array, Array]:
    """Returns information and vector of all sensors, or of all but one; then `known` takes the place of the prior."""
    unknowns = len(next(iter(equations.values()))[1])
    information, vector = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    if known is not None:
        information[: len(known), : len(known)] = known
    for sensor, (matrix, side) in equations.items():
        if sensor != without and not (known is not None and sensor == "prior"):
            information += matrix.toarray()
            vector += side
    return information, vector
