"""Sensors that a simulation has besides its cameras: an IMU, a GNSS antenna, a wheel odometer and a laser scanner.

    sim:city?motion=drive&sensor=imu&sensor=gnss:noise_m=0.5,outage_from_s=5,outage_until_s=15

Each measures the true motion, and then errs as its settings say: noise, bias, a lever arm, a clock that is late, an
outage, and the slip of a wheel. What the rig holds of it (pose, noise) is what a person would know. The same seed gives
the same errors. The motions `drive` and `loop` are those of a vehicle; only `drive` rolls without sliding sideways.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Annotated, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, so3_exp, so3_log
from ispom.settings import Range
from ispom.simulation.places.meshes import MeshPlace
from ispom.simulation.rendering.scene import Scene
from ispom.simulation.truth import Profiler
from ispom.types import (
    GnssAntenna,
    GnssFix,
    Imu,
    ImuSamples,
    LaserScan,
    LaserScanner,
    Measurement,
    Sensor,
    TimedPoints,
    WheelIncrement,
    WheelOdometer,
)

GRAVITY_M_S2 = np.array([0.0, 9.81, 0.0])
"""Gravity in the world, whose y axis points down."""
STENCIL_NS = 5_000_000
"""Step of the differences that give velocities and accelerations: exact to 1e-4 m/s^2 for a shake of 4 Hz."""
WHEEL_STEP_NS = 5_000_000
"""Interval in which the way of a wheel is straight."""
LOCAL_FROM_AHEAD = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""East, north, up of right, down, ahead, where ahead is north."""
LEVEL_FROM_VEHICLE = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""Right, down, ahead of ahead, left, up."""


@dataclass(frozen=True, eq=False)
class Scenery:
    """What sensors measure in."""

    pose_at: Callable[[int], Pose]
    """world_from_rig at a time [ns]."""
    frames_ns: NDArray[np.int64]
    """Times of the frames."""
    scene: Callable[[], Scene | MeshPlace]
    seed: int

    def times_ns(self, rate_hz: float) -> NDArray[np.int64]:
        """Returns times from the first frame to the last one."""
        first, last = self.frames_ns[[0, -1]]
        return first + np.rint(np.arange(int((last - first) * 1e-9 * rate_hz) + 1) * 1e9 / rate_hz).astype(np.int64)

    def random(self, name: str) -> np.random.Generator:
        """Returns a generator that depends on the seed and the sensor."""
        return np.random.default_rng([self.seed, *name.encode()])


class SimulatedSensor(Protocol):
    """A frozen dataclass of plain values."""

    name: ClassVar[str]

    def sensor(self) -> Sensor:
        """Returns the entry of the rig."""
        ...

    def measured(self, scenery: Scenery) -> Iterator[Measurement]:
        """Yields what it measures, in the order of time."""
        ...


@dataclass(frozen=True, kw_only=True)
class Common:
    """Settings of all sensors."""

    late_ms: Annotated[float, Range(-1000, 1000)] = 0.0
    """Its time stamps are later than the true times by this [ms]."""
    outage_from_s: Annotated[float, Range(0, 3600)] = 0.0
    """Begin of an outage, after the first frame [s]."""
    outage_until_s: Annotated[float, Range(0, 3600)] = 0.0
    """End of the outage [s]; there is none where it does not end after its begin."""

    def stamps_ns(self, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Returns time stamps of true times."""
        return times_ns + round(1e6 * self.late_ms)

    def works(self, scenery: Scenery, time_ns: int) -> bool:
        """Checks that there is no outage at a true time."""
        since_s = (time_ns - int(scenery.frames_ns[0])) * 1e-9
        return not self.outage_from_s <= since_s < self.outage_until_s


@dataclass(frozen=True, kw_only=True)
class SimulatedImu(Common):
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
        part = np.searchsorted(scenery.frames_ns, stamps)
        for index in np.split(np.arange(len(stamps)), np.flatnonzero(np.diff(part)) + 1):
            if len(index):
                yield ImuSamples(int(stamps[index[-1]]), stamps[index], rates[index], forces[index], self.name)

    def _error(self, rng: np.random.Generator, count: int, bias: float, noise: float, walk: float) -> Array:
        """Returns bias and noise (count, 3) of samples, whose bias changes by `walk` from one to the next."""
        direction, steps, white = rng.normal(size=3), *rng.normal(size=(2, count, 3))
        return bias * direction / np.linalg.norm(direction) + self.noise * (
            walk * np.cumsum(steps, axis=0) + noise * white
        )


@dataclass(frozen=True, kw_only=True)
class SimulatedGnss(Common):
    """A GNSS receiver. North of its local frame is `heading_deg` to the left of the world's z axis."""

    name: ClassVar[str] = "gnss"
    rate_hz: Annotated[float, Range(0.1, 50)] = 2.0
    """Fixes per second."""
    noise_m: Annotated[float, Range(0, 100)] = 0.3
    """Standard deviation east and north [m], and of half the height: that of a differential receiver."""
    stated_m: Annotated[float, Range(0, 100)] = 0.0
    """What the fixes state as it [m]; 0: the true one."""
    heading_deg: Annotated[float, Range(-180, 180)] = 30.0
    """Heading of the world's z axis, clockwise from north [deg]."""
    arm_m: Annotated[float, Range(-20, 20)] = 0.5
    """Lever arm: how far the antenna is behind the rig's origin [m]; it is as far above it."""
    wrong_arm_m: Annotated[float, Range(-20, 20)] = 0.0
    """The rig states a position that is farther to the right than the true one by this [m]."""
    jump_m: Annotated[float, Range(-1000, 1000)] = 0.0
    """Fixes are too far east by this [m] during the jump, as by a reflected signal."""
    jump_from_s: Annotated[float, Range(0, 3600)] = 0.0
    """Begin of the jump, after the first frame [s]."""
    jump_until_s: Annotated[float, Range(0, 3600)] = 3600.0
    """End of the jump [s]."""

    def sensor(self) -> GnssAntenna:
        return GnssAntenna(rig_from_sensor=Pose(translation=self._arm + np.array([self.wrong_arm_m, 0.0, 0.0])))

    @property
    def _arm(self) -> Array:
        return np.array([0.0, -self.arm_m, -self.arm_m])

    @property
    def local_from_world(self) -> Array:
        """(3, 3); both frames have the same origin."""
        return so3_exp(np.array([0.0, 0.0, -np.radians(self.heading_deg)])) @ LOCAL_FROM_AHEAD

    def measured(self, scenery: Scenery) -> Iterator[Measurement]:
        rng, times_ns = scenery.random(self.name), scenery.times_ns(self.rate_hz)
        errors = rng.normal(size=(len(times_ns), 3)) * self.noise_m * np.array([1.0, 1.0, 2.0])
        sigma = max(self.stated_m or self.noise_m, 1e-3) * np.array([1.0, 1.0, 2.0])
        for true_ns, stamp_ns, error in zip(times_ns.tolist(), self.stamps_ns(times_ns).tolist(), errors, strict=True):
            if not self.works(scenery, true_ns):
                continue
            xyz = self.local_from_world @ scenery.pose_at(true_ns).apply(self._arm) + error
            since_s = (true_ns - int(scenery.frames_ns[0])) * 1e-9
            if self.jump_from_s <= since_s < self.jump_until_s:
                xyz = xyz + np.array([self.jump_m, 0.0, 0.0])
            yield GnssFix(stamp_ns, xyz, np.diag(sigma**2), self.name)


@dataclass(frozen=True, kw_only=True)
class SimulatedWheel(Common):
    """A pair of wheels with encoders below the rig's origin, as of a differential drive."""

    name: ClassVar[str] = "wheel"
    rate_hz: Annotated[float, Range(1, 200)] = 20.0
    """Increments per second."""
    noise: Annotated[float, Range(0, 100)] = 1.0
    """Factor of the noise: 1 is 0.01 m and 0.01 rad (1 sigma) in the first metre, growing with the root of the way."""
    bias: Annotated[float, Range(-0.5, 0.5)] = 0.0
    """Share by which all distances are too long, as of a wheel with too little air."""
    slip: Annotated[float, Range(-1, 10)] = 0.0
    """Share by which distances are too long while the wheels slip; -1: they are blocked."""
    slip_from_s: Annotated[float, Range(0, 3600)] = 0.0
    """Begin of the slip, after the first frame [s]."""
    slip_until_s: Annotated[float, Range(0, 3600)] = 3600.0
    """End of the slip [s]."""
    pair: bool = True
    """Also measures the rotation; otherwise one wheel is measured (a distance measuring instrument)."""
    arm_m: Annotated[float, Range(-10, 10)] = 1.6
    """Lever arm: how far the wheels are below the rig's origin [m]."""

    def sensor(self) -> WheelOdometer:
        return WheelOdometer(rig_from_sensor=Pose(LEVEL_FROM_VEHICLE, np.array([0.0, self.arm_m, 0.0])))

    def measured(self, scenery: Scenery) -> Iterator[Measurement]:
        odometer, rng = self.sensor(), scenery.random(self.name)
        times_ns = scenery.times_ns(self.rate_hz)
        for since_ns, time_ns in pairwise(times_ns.tolist()):
            way, turn = rolled(scenery.pose_at, since_ns, time_ns, odometer.rig_from_sensor)
            noise = self.noise * np.sqrt(abs(way)) * rng.normal(size=2)
            if not (self.works(scenery, since_ns) and self.works(scenery, time_ns)):
                continue
            since_s = (since_ns - int(scenery.frames_ns[0])) * 1e-9
            slip = self.slip if self.slip_from_s <= since_s < self.slip_until_s else 0.0
            distance = way * (1 + self.bias + slip) + odometer.distance_noise * noise[0]
            turned = turn + odometer.rotation_noise_rad * noise[1] if self.pair else None
            stamps = self.stamps_ns(np.array([since_ns, time_ns])).tolist()
            yield WheelIncrement(stamps[1], stamps[0], float(distance), turned, self.name)


@dataclass(frozen=True, kw_only=True)
class SimulatedLaser(Common):
    """A level two-dimensional laser scanner that sees all around, as on a small robot."""

    name: ClassVar[str] = "laser"
    rate_hz: Annotated[float, Range(1, 50)] = 5.0
    """Scans per second."""
    points: Annotated[int, Range(20, 10_000)] = 720
    """Beams of a scan."""
    noise_m: Annotated[float, Range(0, 10)] = 0.02
    """Standard deviation of a range [m]."""
    reach_m: Annotated[float, Range(1, 300)] = 30.0
    """Farther points are not measured [m]."""
    arm_m: Annotated[float, Range(-10, 10)] = 0.3
    """Lever arm: how far the scanner is below the rig's origin [m]."""

    def sensor(self) -> LaserScanner:
        pose = Pose(LEVEL_FROM_VEHICLE, np.array([0.0, self.arm_m, 0.0]))
        return LaserScanner(rig_from_sensor=pose, range_noise_m=max(self.noise_m, 1e-3))

    def measured(self, scenery: Scenery) -> Iterator[Measurement]:
        rate = self.points * self.rate_hz
        pose = self.sensor().rig_from_sensor
        scanner = Profiler(rate, self.rate_hz, self.reach_m, self.noise_m, pose)
        for k, (start_ns, end_ns) in enumerate(pairwise(scenery.times_ns(self.rate_hz).tolist())):
            if not (self.works(scenery, start_ns) and self.works(scenery, end_ns)):
                continue
            seen = scanner.scan(scenery.scene(), scenery.pose_at, start_ns, end_ns, 100_003 * scenery.seed + k)
            points = TimedPoints(self.stamps_ns(seen.times_ns), seen.xyz_in_laser)
            yield LaserScan(int(self.stamps_ns(np.array([end_ns]))[0]), points, self.name)


SENSORS: dict[str, type] = {s.name: s for s in (SimulatedImu, SimulatedGnss, SimulatedWheel, SimulatedLaser)}
"""Sensors by their name in files and addresses: their kind, and their name in the rig."""


def true_imu(pose_at: Callable[[int], Pose], times_ns: NDArray[np.int64], rig_from_imu: Pose) -> tuple[Array, Array]:
    """Returns angular velocities (N, 3) [rad/s] and specific forces (N, 3) [m/s^2] along the unit's axes."""
    h, h_ns = STENCIL_NS * 1e-9, STENCIL_NS
    rates, forces = np.zeros((len(times_ns), 3)), np.zeros((len(times_ns), 3))
    imu_at = lru_cache(maxsize=16)(lambda t: pose_at(t) @ rig_from_imu)  # samples share poses
    for i, t in enumerate(times_ns.tolist()):
        far, before, now, after, end = (imu_at(t + k * h_ns) for k in (-2, -1, 0, 1, 2))
        narrow = so3_log(before.rotation.T @ after.rotation) / (2 * h)
        wide = so3_log(far.rotation.T @ end.rotation) / (4 * h)
        rates[i] = (4 * narrow - wide) / 3  # Richardson: the error of h^2 cancels
        near, outer = before.translation + after.translation, far.translation + end.translation
        acceleration = (16 * near - outer - 30 * now.translation) / (12 * h**2)
        forces[i] = now.rotation.T @ (acceleration - GRAVITY_M_S2)
    return rates, forces


def rolled(pose_at: Callable[[int], Pose], since_ns: int, until_ns: int, rig_from_wheel: Pose) -> tuple[float, float]:
    """Returns the way [m] along the odometer's x axis, and the rotation [rad] about its z axis."""
    count = max(1, round((until_ns - since_ns) / WHEEL_STEP_NS))
    times_ns = np.linspace(since_ns, until_ns, count + 1).astype(np.int64)
    poses = [pose_at(t) @ rig_from_wheel for t in times_ns.tolist()]
    twists = np.array([(a.inverse() @ b).log() for a, b in pairwise(poses)]).sum(axis=0)
    return float(twists[0]), float(twists[5])
