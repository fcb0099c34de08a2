"""The factor graph of `fused`: a window of nodes, each with pose, velocity, biases and the scale of the images.

Built anew for each node with gtsam (Dellaert and Kaess, Factor Graphs for Robot Perception, 2017; preintegrated IMU:
Forster et al. 2017), from numbers only, so that a State is a value. What leaves the window stays as a prior: its
information on the next node (Schur complement). The same is kept once more without each sensor, which shows how much
that sensor contributes. Poses are those of the body: of the IMU where one takes part, so that its lever arm is exact,
else of the rig. The local frame is east, north, up, or of any heading without GNSS.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np
from scipy.linalg import block_diag

from ispom.estimators.survey.fused_links import FLOOR_M, FLOOR_RAD, Fix, Inertial, Link
from ispom.geometry import Array, Pose, skew, so3_log
from ispom.types import Imu, Rig

ORDER = np.array([3, 4, 5, 0, 1, 2])
"""Twists of gtsam are (phi, rho), those here (rho, phi)."""
SIZES = {"x": 6, "v": 3, "b": 6, "s": 1}
DIMENSIONS = {"visual": 6, "imu": 9, "gnss": 3, "wheel": 3, "laser": 3}
"""Of the residuals of one factor, in which the sensor measures something."""
LOSS = 2.0
"""Width of the Cauchy loss of fixes and relative poses [standard deviations]."""
GRAVITY_M_S2 = 9.81
ITERATIONS = 12
BLIND = np.diag([50.0, 50.0, 50.0, 0.5, 0.5, 0.5]) ** 2
"""Covariance of a motion that nothing measured."""
FRESH = 1.0
"""Standard deviation of the change of the log scale where the images begin anew."""
BIAS_PRIOR = np.array([0.3] * 3 + [0.02] * 3)
"""Standard deviations at the start: accelerometer [m/s^2], gyroscope [rad/s], of a calibrated MEMS unit."""
SPEED_PRIOR = 3.0
"""Standard deviation of the velocity at the start [m/s]."""
RELAXED = 1e-9
"""Information added where nothing holds a parameter."""


@dataclass(frozen=True, eq=False)
class Node:
    """A time of the window, its estimate, and what was measured since the node before."""

    number: int
    time_ns: int
    local_from_rig: Pose = Pose()
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) of the body in the local frame [m/s]."""
    bias: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) accelerometer, gyroscope."""
    log_scale: float = 0.0
    """Logarithm of the metres per unit of the images."""
    camera: Pose | None = None
    """world_from_camera of the images, in their unit."""
    visual: Pose | None = None
    """camera_before_from_camera_now, in the unit of the images."""
    fresh: bool = False
    """The unit of the images is not that of the node before."""
    inertial: Inertial | None = None
    wheel: Link | None = None
    way_m: float = 0.0
    """Measured by the wheels."""
    slipped: bool = False
    laser: Link | None = None
    fixes: tuple[Fix, ...] = ()

    @property
    def blind(self) -> bool:
        """Whether no sensor measured the motion since the node before."""
        return all(each is None for each in (self.visual, self.inertial, self.wheel, self.laser))


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known of the first node of the window by all that left it."""

    at: Node
    """Where it is linear."""
    information: Array
    """(D, D)"""
    vector: Array
    """(D,) information times the most likely difference."""
    without: Mapping[str, Array]
    """(D, D) information without each sensor."""


@dataclass(frozen=True, eq=False)
class Factor:
    """A factor of gtsam, which sensor made it, and the node to which it leads."""

    sensor: str
    value: Any
    to: int
    robust: bool = True

    def misfit(self, values: Any) -> float:
        """Returns the squared residual, in variances, without the loss."""
        cost = float(self.value.error(values))
        return LOSS**2 * float(np.expm1(2 * cost / LOSS**2)) if self.robust else 2 * cost


@dataclass(frozen=True)
class Noise:
    """Of the motions that the images give."""

    turn: float
    """Standard deviation of a rotation, by the root of the time [rad/sqrt(s)]."""
    share: float
    """Of a translation, by its length."""
    scale_walk: float
    """Of the log scale, by the root of the time [1/sqrt(s)]."""

    def covariance(self, length_m: float, seconds: float) -> Array:
        """Returns (6, 6) of the twist (rho [m], phi) of a motion."""
        place, turn = self.share * length_m + FLOOR_M, self.turn * np.sqrt(seconds) + 0.1 * FLOOR_RAD
        return np.diag([place] * 3 + [turn] * 3) ** 2


class Graph:
    """Estimates the nodes of a window."""

    def __init__(self, rig: Rig, sensors: frozenset[str], camera_from_rig: Pose, noise: Noise) -> None:
        imu = next((s for s in rig.sensors.values() if isinstance(s, Imu)), None) if "imu" in sensors else None
        self.imu, self.sensors, self.noise = imu, sensors, noise
        self.camera_from_rig = camera_from_rig
        self.rig_from_body = Pose() if imu is None else imu.rig_from_sensor
        self.letters = "xvbs" if imu is not None else "xs"
        self.starts = dict(zip(self.letters, np.cumsum([0, *(SIZES[c] for c in self.letters)]), strict=False))
        self.size = sum(SIZES[c] for c in self.letters)

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
        import gtsam

        factors, values = self.factors(nodes, prior), self._values(nodes)
        graph = gtsam.NonlinearFactorGraph()
        for factor in factors:
            graph.add(factor.value)
        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setMaxIterations(ITERATIONS)
        values = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
        found = tuple(self._node(node, values) for node in nodes)
        misfits = dict[str, list[float]]()
        for f in factors:
            if f.sensor in DIMENSIONS:
                misfits.setdefault(f.sensor, []).append(f.misfit(values) / DIMENSIONS[f.sensor])
        return found, {sensor: float(np.sqrt(np.mean(some[-6:]))) for sensor, some in misfits.items()}

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
        values, size = self._values(nodes), self.size
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

    def factors(self, nodes: tuple[Node, ...], prior: Prior) -> list[Factor]:
        """Returns all factors of a window."""
        import gtsam

        found = [Factor("prior", self._prior(prior), nodes[0].number, False)]
        for before, now in zip((None, *nodes), nodes, strict=False):
            found += [Factor("gnss", self._fix(fix, now), now.number) for fix in now.fixes if "gnss" in self.sensors]
            if before is None:
                continue
            i, j = before.number, now.number
            seconds = (now.time_ns - before.time_ns) * 1e-9
            walk = FRESH if now.fresh else self.noise.scale_walk * np.sqrt(seconds)
            keep = gtsam.noiseModel.Isotropic.Sigma(1, walk)
            keys = gtsam.symbol("s", i), gtsam.symbol("s", j)
            found.append(Factor("scale", gtsam.BetweenFactorVector(*keys, np.zeros(1), keep), j, False))
            if now.visual is not None:
                found.append(Factor("visual", self._visual(now, seconds, i, j), j))
            for name, link in (("wheel", None if now.slipped else now.wheel), ("laser", now.laser)):
                if link is not None and name in self.sensors:
                    found.append(Factor(name, self._relative(link, i, j), j))
            if self.imu is not None:
                found += self._inertial(before, now, self.imu, seconds)
            if now.blind:
                found.append(Factor("blind", self._relative(Link(Pose(), BLIND), i, j, robust=False), j, False))
        return found

    def _inertial(self, before: Node, now: Node, imu: Imu, seconds: float) -> list[Factor]:
        import gtsam

        i, j, model = before.number, now.number, gtsam.noiseModel
        x, v, b = ((gtsam.symbol(c, i), gtsam.symbol(c, j)) for c in "xvb")
        if now.inertial is None:
            walk = np.repeat([imu.accelerometer_walk, imu.gyroscope_walk], 3) * np.sqrt(seconds)
            bias = gtsam.BetweenFactorConstantBias(*b, gtsam.imuBias.ConstantBias(), model.Diagonal.Sigmas(walk))
            speed = gtsam.PriorFactorVector(v[1], now.velocity, model.Isotropic.Sigma(3, 5.0))
            return [Factor("blind", bias, j, False), Factor("blind", speed, j, False)]
        parameters = gtsam.PreintegrationCombinedParams.MakeSharedU(GRAVITY_M_S2)
        parameters.setAccelerometerCovariance(np.eye(3) * imu.accelerometer_noise**2)
        parameters.setGyroscopeCovariance(np.eye(3) * imu.gyroscope_noise**2)
        parameters.setBiasAccCovariance(np.eye(3) * imu.accelerometer_walk**2)
        parameters.setBiasOmegaCovariance(np.eye(3) * imu.gyroscope_walk**2)
        parameters.setIntegrationCovariance(np.eye(3) * 1e-8)
        summed = gtsam.PreintegratedCombinedMeasurements(parameters, _bias(before.bias))
        samples = now.inertial
        for dt, rate, force in zip(samples.seconds.tolist(), samples.rates, samples.forces, strict=True):
            summed.integrateMeasurement(force, rate, dt)
        return [Factor("imu", gtsam.CombinedImuFactor(x[0], v[0], x[1], v[1], *b, summed), j, False)]

    def _fix(self, fix: Fix, node: Node) -> Any:
        """Of an antenna at the time of the fix, by the motion of the images from there to the node."""
        import gtsam

        antenna = self.camera_from_rig.apply(fix.antenna_in_rig)
        antenna = fix.camera_from_then.scaled(np.exp(node.log_scale)).apply(antenna)
        arm = (self.rig_from_body.inverse() @ self.camera_from_rig.inverse()).apply(antenna)
        return gtsam.GPSFactorArm(gtsam.symbol("x", node.number), fix.xyz_in_local, arm, _robust(fix.covariance))

    def _relative(self, link: Link, i: int, j: int, robust: bool = True) -> Any:
        import gtsam

        body_from_rig = self.rig_from_body.inverse()
        along = body_from_rig.adjoint
        covariance = (along @ link.covariance @ along.T)[np.ix_(ORDER, ORDER)]
        noise = _robust(covariance) if robust else gtsam.noiseModel.Gaussian.Covariance(covariance)
        relative = _pose3(body_from_rig @ link.relative @ self.rig_from_body)
        return gtsam.BetweenFactorPose3(gtsam.symbol("x", i), gtsam.symbol("x", j), relative, noise)

    def _visual(self, node: Node, seconds: float, i: int, j: int) -> Any:
        """Residuals: the rotation, and the translation [m] times the scale at the node."""
        import gtsam

        relative = node.visual
        assert relative is not None
        body_from_camera = self.rig_from_body.inverse() @ self.camera_from_rig.inverse()
        to_camera = body_from_camera.inverse().adjoint[np.ix_(ORDER, ORDER)]
        keys = [gtsam.symbol("x", i), gtsam.symbol("x", j), gtsam.symbol("s", j)]
        length = float(np.exp(node.log_scale) * np.linalg.norm(relative.translation))
        covariance = self.noise.covariance(length, seconds)[np.ix_(ORDER, ORDER)]

        def error(this: Any, values: Any, jacobians: Any) -> Array:
            first, second = (Pose.from_matrix(values.atPose3(k).matrix()) @ body_from_camera for k in keys[:2])
            moved, scale = first.inverse() @ second, np.exp(values.atVector(keys[2])[0])
            if jacobians is not None:
                by_first, by_second = np.zeros((6, 6)), np.zeros((6, 6))
                by_first[:3, :3], by_second[:3, :3] = -moved.rotation.T, np.eye(3)
                by_first[3:, :3], by_first[3:, 3:], by_second[3:, 3:] = (
                    skew(moved.translation),
                    -np.eye(3),
                    moved.rotation,
                )
                jacobians[0], jacobians[1] = by_first @ to_camera, by_second @ to_camera
                jacobians[2] = np.concatenate([np.zeros(3), -scale * relative.translation])[:, None]
            turn = so3_log(relative.rotation.T @ moved.rotation)
            return np.concatenate([turn, moved.translation - scale * relative.translation])

        return gtsam.CustomFactor(_robust(covariance), keys, cast(Any, error))

    def _prior(self, prior: Prior) -> Any:
        import gtsam

        sizes, turned = np.linalg.eigh(prior.information)
        known = sizes > 1e-12 * sizes[-1]
        root = np.sqrt(sizes[known])[:, None] * turned[:, known].T
        side = turned[:, known].T @ prior.vector / np.sqrt(sizes[known])
        keys = [gtsam.symbol(c, prior.at.number) for c in self.letters]
        at, parts = self._parts(prior.at), [self.starts[c] for c in self.letters]

        def error(this: Any, values: Any, jacobians: Any) -> Array:
            difference = list[Array]()
            for letter, key in zip(self.letters, keys, strict=True):
                read: Callable[[int], Any] = {"x": values.atPose3, "b": values.atConstantBias}.get(
                    letter, values.atVector
                )
                now = read(key)
                if letter == "x":
                    difference.append(at["x"].localCoordinates(now))
                else:
                    difference.append(now.vector() - at["b"].vector() if letter == "b" else now - at[letter])
            if jacobians is not None:
                for n, part in enumerate(parts):
                    jacobians[n] = root[:, part : part + SIZES[self.letters[n]]]
            return root @ np.concatenate(difference) - side

        return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(int(known.sum())), keys, cast(Any, error))

    def _parts(self, node: Node) -> dict[str, Any]:
        return {
            "x": _pose3(node.local_from_rig @ self.rig_from_body),
            "v": node.velocity,
            "b": _bias(node.bias),
            "s": np.array([node.log_scale]),
        }

    def _values(self, nodes: tuple[Node, ...]) -> Any:
        import gtsam

        values = gtsam.Values()
        for node in nodes:
            parts = self._parts(node)
            for letter in self.letters:
                values.insert(gtsam.symbol(letter, node.number), parts[letter])
        return values

    def _node(self, node: Node, values: Any) -> Node:
        import gtsam

        key = {c: gtsam.symbol(c, node.number) for c in self.letters}
        pose = Pose.from_matrix(values.atPose3(key["x"]).matrix()) @ self.rig_from_body.inverse()
        found = replace(node, local_from_rig=pose, log_scale=float(values.atVector(key["s"])[0]))
        if self.imu is None:
            return found
        return replace(found, velocity=values.atVector(key["v"]), bias=values.atConstantBias(key["b"]).vector())


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


def _robust(covariance: Array) -> Any:
    import gtsam

    model = gtsam.noiseModel
    return model.Robust.Create(model.mEstimator.Cauchy.Create(LOSS), model.Gaussian.Covariance(covariance))


def _bias(values: Array) -> Any:
    import gtsam

    return gtsam.imuBias.ConstantBias(values[:3], values[3:])


def _pose3(pose: Pose) -> Any:
    import gtsam

    return gtsam.Pose3(gtsam.Rot3(pose.rotation), pose.translation)
