"""Inertial measurement units: angular velocities and specific forces, preintegrated between nodes.

Reference: Forster et al. 2017, "On-Manifold Preintegration for Real-Time Visual-Inertial Odometry".
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, so3_exp, so3_log
from ispom.plausibility import Doubt
from ispom.plausibility.imu import imu_doubts
from ispom.plausibility.times import Rates
from ispom.sensors.fusion import POSE, Factor, GraphFrames, Node, NodeContext, Variable
from ispom.sensors.kind import FileOptions, Readings, SensorKind, Table
from ispom.sensors.simulated import Scenery, SensorFaults
from ispom.settings import Range
from ispom.types import Imu, ImuSamples, Measurement

COLUMNS = ("gx", "gy", "gz", "ax", "ay", "az")
GRAVITY_M_S2 = 9.81
LONGEST_GAP_S = 0.15
"""An IMU without a sample for longer has an outage."""
SPEED_SIGMA = 3.0
"""Standard deviation of the velocity at the start [m/s]."""
BIAS_SIGMA = np.array([0.3] * 3 + [0.02] * 3)
"""Standard deviations at the start: accelerometer [m/s^2], gyroscope [rad/s], of a calibrated MEMS unit."""
UNMEASURED_SPEED = 5.0
"""Standard deviation of the velocity after an outage [m/s]."""
STENCIL_NS = 5_000_000
"""Step of the differences that give velocities and accelerations: exact to 1e-4 m/s^2 for a shake of 4 Hz."""


# What is simulated.


@dataclass(frozen=True, kw_only=True)
class SimulatedImu(SensorFaults):
    """An IMU as in a phone or a small vehicle (a consumer MEMS unit), with the axes of the rig's cameras."""

    name: ClassVar[str] = "imu"
    rate_hz: Annotated[float, Range(20, 1000)] = 100.0
    """Samples per second."""
    noise: Annotated[float, Range(0, 100)] = 1.0
    """Factor of the noise: 1 is 0.001 rad/s/sqrt(Hz) and 0.01 m/s^2/sqrt(Hz), with random walks of the biases of 1e-5
    rad/s^2/sqrt(Hz) and 1e-4 m/s^3/sqrt(Hz)."""
    gyroscope_bias_deg_s: Annotated[float, Range(0, 10)] = 0.2
    """Length of the bias of the gyroscope at the start, in a random direction [deg/s]."""
    accelerometer_bias_m_s2: Annotated[float, Range(0, 5)] = 0.05
    """The same of the accelerometer [m/s^2]."""
    arm_m: Annotated[float, Range(-10, 10)] = 0.1
    """Lever arm: how far the unit is behind the rig's origin [m]."""

    def sensor(self) -> Imu:
        return Imu(rig_from_sensor=Pose(translation=np.array([0.0, 0.0, -self.arm_m])))

    def measured(self, scenery: Scenery) -> Iterator[Measurement]:
        """Yields the samples from one frame to the next as one measurement."""
        unit, rng, rate = self.sensor(), scenery.random(self.name), np.sqrt(self.rate_hz)
        times_ns = scenery.times_ns(self.rate_hz)
        rates, forces = true_imu(scenery.pose_at, times_ns, unit.rig_from_sensor)
        turning, pull = np.radians(self.gyroscope_bias_deg_s), self.accelerometer_bias_m_s2
        rates += self._error(rng, len(rates), turning, unit.gyroscope_noise * rate, unit.gyroscope_walk / rate)
        forces += self._error(rng, len(rates), pull, unit.accelerometer_noise * rate, unit.accelerometer_walk / rate)
        working = np.array([self.works(scenery, int(t)) for t in times_ns])
        stamps, rates, forces = self.stamps_ns(times_ns)[working], rates[working], forces[working]
        yield from _by_frame(stamps, rates, forces, scenery.frames_ns, self.name)

    def _error(self, rng: np.random.Generator, count: int, bias: float, noise: float, walk: float) -> Array:
        """Returns bias and noise (count, 3) of samples, whose bias changes by `walk` from one to the next."""
        direction, steps, white = rng.normal(size=3), *rng.normal(size=(2, count, 3))
        return bias * direction / np.linalg.norm(direction) + self.noise * (
            walk * np.cumsum(steps, axis=0) + noise * white
        )


def true_imu(pose_at: Callable[[int], Pose], times_ns: NDArray[np.int64], rig_from_imu: Pose) -> tuple[Array, Array]:
    """Returns angular velocities (N, 3) [rad/s] and specific forces (N, 3) [m/s^2] along the unit's axes, of a world
    whose y axis points down."""
    h, h_ns = STENCIL_NS * 1e-9, STENCIL_NS
    rates, forces = np.zeros((len(times_ns), 3)), np.zeros((len(times_ns), 3))
    imu_at = lru_cache(maxsize=16)(lambda t: pose_at(t) @ rig_from_imu)  # samples share poses
    gravity = np.array([0.0, GRAVITY_M_S2, 0.0])
    for i, t in enumerate(times_ns.tolist()):
        far, before, now, after, end = (imu_at(t + k * h_ns) for k in (-2, -1, 0, 1, 2))
        narrow = so3_log(before.rotation.T @ after.rotation) / (2 * h)
        wide = so3_log(far.rotation.T @ end.rotation) / (4 * h)
        rates[i] = (4 * narrow - wide) / 3  # Richardson: the error of h^2 cancels
        near, outer = before.translation + after.translation, far.translation + end.translation
        acceleration = (16 * near - outer - 30 * now.translation) / (12 * h**2)
        forces[i] = now.rotation.T @ (acceleration - gravity)
    return rates, forces


# What is observed between two nodes.


@dataclass(frozen=True, eq=False)
class Inertial:
    """Samples of an IMU from one node to the next, as intervals of constant values."""

    seconds: Array
    """(N,) lengths of the intervals."""
    rates: Array
    """(N, 3) [rad/s]."""
    forces: Array
    """(N, 3) [m/s^2]."""


def inertial_of(node: Node) -> Inertial | None:
    """Returns what an IMU measured since the node before; None where it did not all the time."""
    return node.relative.get(KIND.name)


def inertial_between(batches: Sequence[ImuSamples], start_ns: int, end_ns: int) -> Inertial | None:
    """Returns what an IMU measured from one time to another; None where it has an outage."""
    if not batches:
        return None
    times = np.concatenate([b.times_ns for b in batches])
    values = np.concatenate([np.hstack([b.angular_velocity_rad_s, b.specific_force_m_s2]) for b in batches])
    inside = (times > start_ns) & (times < end_ns)
    near = times[(times >= start_ns - 1e9 * LONGEST_GAP_S) & (times <= end_ns + 1e9 * LONGEST_GAP_S)]
    if not len(near) or np.diff([min(start_ns, near[0]), *near, max(end_ns, near[-1])]).max() > 1e9 * LONGEST_GAP_S:
        return None
    knots = np.concatenate([[start_ns], times[inside], [end_ns]])
    at = np.stack([np.interp(knots, times, column) for column in values.T], axis=1)
    middle = 0.5 * (at[1:] + at[:-1])
    return Inertial(np.diff(knots) * 1e-9, middle[:, :3], middle[:, 3:])


def summed(samples: Inertial, bias: Array) -> tuple[Array, Array, Array, float]:
    """Returns rotation, velocity and position that samples add, in the frame of the body before, and the time.

    `bias` (6,) of accelerometer and gyroscope.
    """
    turn, velocity, place, seconds = np.eye(3), np.zeros(3), np.zeros(3), 0.0
    for dt, rate, force in zip(
        samples.seconds.tolist(), samples.rates - bias[3:], samples.forces - bias[:3], strict=True
    ):
        force_then = turn @ so3_exp(0.5 * dt * rate) @ force
        place = place + velocity * dt + 0.5 * dt**2 * force_then
        velocity, seconds, turn = velocity + dt * force_then, seconds + dt, turn @ so3_exp(dt * rate)
    return turn, velocity, place, seconds


def predicted(last: Node, inertial: Inertial, rig_from_body: Pose) -> tuple[Pose, Array]:
    """Returns local_from_rig and the velocity of the body (3,) after what an IMU measured since a node."""
    body = last.local_from_rig @ rig_from_body
    turn, faster, place, seconds = summed(inertial, last.bias)
    gravity = np.array([0.0, 0.0, -GRAVITY_M_S2])
    moved = body.rotation @ place + last.velocity * seconds + 0.5 * seconds**2 * gravity
    pose = Pose(body.rotation @ turn, body.translation + moved) @ rig_from_body.inverse()
    return pose, last.velocity + body.rotation @ faster + seconds * gravity


class Velocity(Variable):
    """The velocity of the body in the local frame [m/s]."""

    letter, size = "v", 3

    def first_information(self) -> Array:
        return np.eye(3) / SPEED_SIGMA**2

    def of(self, node: Node, rig_from_body: Pose) -> Any:
        return node.velocity

    def put(self, node: Node, value: Any, rig_from_body: Pose) -> Node:
        return replace(node, velocity=value)


class Bias(Variable):
    """The biases of accelerometer and gyroscope."""

    letter, size = "b", 6

    def first_information(self) -> Array:
        return np.diag(BIAS_SIGMA**-2.0)

    def of(self, node: Node, rig_from_body: Pose) -> Any:
        return _bias(node.bias)

    def put(self, node: Node, value: Any, rig_from_body: Pose) -> Node:
        return replace(node, bias=value.vector())

    def at(self, values: Any, key: int) -> Any:
        return values.atConstantBias(key)

    def difference(self, then: Any, now: Any) -> Array:
        return now.vector() - then.vector()


VELOCITY, BIAS = Velocity(), Bias()


class ImuKind(SensorKind):
    """An inertial measurement unit."""

    name, label, phrase, order = "imu", "IMU", "an IMU", 1
    sensor, measurement, simulated = Imu, ImuSamples, SimulatedImu
    rates = Rates((1.1, 20_000.0), (9.5, 4_000.0))
    measures, tightly, variables = "relative", True, (VELOCITY, BIAS)

    def readings(self, table: Table, options: FileOptions) -> Readings:
        rows = table.stacked(COLUMNS)
        return Readings(self.name, table.times_ns, {"rates": rows[:, :3], "forces": rows[:, 3:]})

    def collected(self, measured: Sequence[ImuSamples]) -> Readings:
        values = {
            "rates": np.concatenate([m.angular_velocity_rad_s for m in measured]),
            "forces": np.concatenate([m.specific_force_m_s2 for m in measured]),
        }
        return Readings(self.name, np.concatenate([m.times_ns for m in measured]), values)

    def measurements(self, found: Readings, frames_ns: NDArray[np.int64], name: str) -> Iterator[ImuSamples]:
        """Yields the samples from one frame to the next as one measurement."""
        used = found.within(frames_ns)
        samples = found.times_ns[used], found.values["rates"][used], found.values["forces"][used]
        yield from _by_frame(*samples, frames_ns, name)

    def doubts(self, where: str, found: Readings) -> tuple[Doubt, ...]:
        return imu_doubts(where, found.times_ns, found.values["rates"], found.values["forces"])

    def observed(self, memory: Any, at: NodeContext) -> tuple[Inertial | None, Any]:
        return (None if at.last is None else inertial_between(memory or (), at.last.time_ns, at.time_ns)), memory

    def factors(self, before: Node | None, now: Node, frames: GraphFrames) -> list[Factor]:
        import gtsam

        if before is None:
            return []
        imu, model, seconds = frames.sensor(Imu), gtsam.noiseModel, (now.time_ns - before.time_ns) * 1e-9
        x, v, b = ((each.key(before), each.key(now)) for each in (POSE, VELOCITY, BIAS))
        samples = inertial_of(now)
        if samples is None:
            walk = np.repeat([imu.accelerometer_walk, imu.gyroscope_walk], 3) * np.sqrt(seconds)
            bias = gtsam.BetweenFactorConstantBias(*b, gtsam.imuBias.ConstantBias(), model.Diagonal.Sigmas(walk))
            speed = gtsam.PriorFactorVector(v[1], now.velocity, model.Isotropic.Sigma(3, UNMEASURED_SPEED))
            return [Factor("blind", bias, now.number), Factor("blind", speed, now.number)]
        parameters = gtsam.PreintegrationCombinedParams.MakeSharedU(GRAVITY_M_S2)
        parameters.setAccelerometerCovariance(np.eye(3) * imu.accelerometer_noise**2)
        parameters.setGyroscopeCovariance(np.eye(3) * imu.gyroscope_noise**2)
        parameters.setBiasAccCovariance(np.eye(3) * imu.accelerometer_walk**2)
        parameters.setBiasOmegaCovariance(np.eye(3) * imu.gyroscope_walk**2)
        parameters.setIntegrationCovariance(np.eye(3) * 1e-8)
        integrated = gtsam.PreintegratedCombinedMeasurements(parameters, _bias(before.bias))
        for dt, rate, force in zip(samples.seconds.tolist(), samples.rates, samples.forces, strict=True):
            integrated.integrateMeasurement(force, rate, dt)
        factor = gtsam.CombinedImuFactor(x[0], v[0], x[1], v[1], *b, integrated)
        return [Factor(self.name, factor, now.number, 9)]


def _by_frame(
    times_ns: NDArray[np.int64], rates: Array, forces: Array, frames_ns: NDArray[np.int64], name: str
) -> Iterator[ImuSamples]:
    """Yields the samples from one frame to the next."""
    part = np.searchsorted(frames_ns, times_ns)
    for index in np.split(np.arange(len(times_ns)), np.flatnonzero(np.diff(part)) + 1):
        if len(index):
            yield ImuSamples(int(times_ns[index[-1]]), times_ns[index], rates[index], forces[index], name)


def _bias(values: Array) -> Any:
    import gtsam

    return gtsam.imuBias.ConstantBias(values[:3], values[3:])


KIND = ImuKind()
