"""GNSS receivers: positions of an antenna in a local frame of east, north and up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array, Pose, so3_exp
from ispom.plausibility import Doubt
from ispom.plausibility.gnss import geodetic_doubts, gnss_doubts, null_fixes
from ispom.plausibility.times import Rates
from ispom.sensors.fusion import POSE, Factor, GraphFrames, Node, NodeContext, between
from ispom.sensors.kind import FileOptions, Readings, SensorKind, Table
from ispom.sensors.simulated import Scenery, SensorFaults
from ispom.settings import Range
from ispom.types import GnssAntenna, GnssFix, Measurement

LOCAL, GEODETIC = ("x", "y", "z"), ("lat", "lon", "height")
SIGMAS = ("sigma_x", "sigma_y", "sigma_z")
"""Columns of tables, besides `sigma` of all three."""
MIN_SIGMA, MAX_SIGMA = 1e-12, 1e9
"""Range of standard deviations [m], whose squares and inverse squares are still finite."""
MOST_WAITING = 50
"""Fixes that wait for a node."""
LOCAL_FROM_AHEAD = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""East, north, up of right, down, ahead, where ahead is north."""


@dataclass(frozen=True, kw_only=True)
class SimulatedGnss(SensorFaults):
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


@dataclass(frozen=True, eq=False)
class Fix:
    """The position of an antenna, near the time of a node."""

    xyz_in_local: Array
    covariance: Array
    antenna_in_rig: Array
    """(3,)"""
    camera_from_then: Pose
    """The camera of the node from the camera at the time of the fix, in the unit of the images."""


def fixes_of(node: Node) -> tuple[Fix, ...]:
    """Returns the fixes of a node."""
    return node.absolute.get(KIND.name, ())


def geodetic_values(where: str, geodetic: Array, sigma: Array, origin: Array | None = None) -> dict[str, Array]:
    """Returns the values of Readings of fixes: latitude, longitude [deg] and height [m] (N, 3), and their standard
    deviations (N, 3) [m]. Raises InputError, which begins with `where`, for positions that are nowhere."""
    doubts, nowhere = geodetic_doubts(where, geodetic)
    if nowhere:
        raise InputError(str(doubts[0]).rstrip("."))
    if not len(geodetic):
        raise InputError(f"{where} has no fix: leave it out")
    first = geodetic[int(np.argmin(null_fixes(geodetic)))]  # that is a fix
    return {"xyz": local_of(geodetic, first if origin is None else origin), "sigma": sigma, "geodetic": geodetic}


def local_of(geodetic: Array, origin: Array) -> Array:
    """Returns east, north and up (N, 3) [m] of latitude, longitude [deg] and ellipsoidal height [m] (N, 3). Raises
    InputError where pymap3d is not installed."""
    if find_spec("pymap3d") is None:
        raise InputError("latitude and longitude need pymap3d, of the extra `fusion`: run pip install 'ispom[fusion]'")
    import pymap3d

    return np.stack(pymap3d.geodetic2enu(*np.asarray(geodetic, float).T, *origin), axis=1)


def _sigma(table: Table, default_m: float | None) -> Array:
    """Returns standard deviations (N, 3) [m] of a table.

    Raises InputError where neither the table nor the default has them, or one is out of bounds.
    """
    if table.has(SIGMAS):
        sigma = table.stacked(SIGMAS)
    elif table.has(("sigma",)):
        sigma = np.repeat(table.stacked(("sigma",)), 3, axis=1)
    elif default_m is not None:
        sigma = np.full((len(table.times_ns), 3), default_m)
    else:
        raise InputError(f"{table.path} has no column sigma: add it, or give `sigma_m` [m] of the fixes")
    for end in (sigma.min(), sigma.max()):
        if not MIN_SIGMA <= end <= MAX_SIGMA:
            bounds = f"give a value from {MIN_SIGMA:g} to {MAX_SIGMA:g}"
            raise InputError(f"{table.path}: a standard deviation is {end:g}, {bounds}")
    return sigma


class GnssKind(SensorKind):
    """A GNSS receiver."""

    name, label, phrase, order = "gnss", "GNSS", "a GNSS antenna", 2
    sensor, measurement, simulated = GnssAntenna, GnssFix, SimulatedGnss
    rates = Rates((0.022, 200.0), (0.1, 100.0))
    measures, tightly, makes_nodes = "absolute", True, True

    def readings(self, table: Table, options: FileOptions) -> Readings:
        sigma = _sigma(table, options.sigma_m)
        if not table.has(GEODETIC):
            return Readings(self.name, table.times_ns, {"xyz": table.stacked(LOCAL), "sigma": sigma})
        if options.sigma_m is not None:
            sigma = np.full_like(sigma, options.sigma_m)
        values = geodetic_values(options.where, table.stacked(GEODETIC), sigma, options.origin)
        return Readings(self.name, table.times_ns, values)

    def collected(self, measured: Sequence[GnssFix]) -> Readings:
        times_ns = np.array([m.time_ns for m in measured], np.int64)
        sigma = np.sqrt(np.stack([np.diag(m.covariance) for m in measured]))
        return Readings(self.name, times_ns, {"xyz": np.stack([m.xyz_in_local for m in measured]), "sigma": sigma})

    def measurements(self, found: Readings, frames_ns: NDArray[np.int64], name: str) -> Iterator[GnssFix]:
        used = found.within(frames_ns)
        if "geodetic" in found.values:
            used &= ~null_fixes(found.values["geodetic"])
        for i in np.flatnonzero(used).tolist():
            covariance = np.diag(found.values["sigma"][i] ** 2)
            yield GnssFix(int(found.times_ns[i]), found.values["xyz"][i], covariance, name)

    def doubts(self, where: str, found: Readings) -> tuple[Doubt, ...]:
        geodetic = found.values.get("geodetic")
        first, null = ((), None) if geodetic is None else (geodetic_doubts(where, geodetic)[0], null_fixes(geodetic))
        return (*first, *gnss_doubts(where, found.times_ns, found.values["xyz"], found.values["sigma"], null))

    def remembered(self, memory: Any, measurement: Any, oldest_ns: int) -> Any:
        return (*(memory or ()), measurement)[-MOST_WAITING:]

    def observed(self, memory: Any, at: NodeContext) -> tuple[tuple[Fix, ...] | None, Any]:
        found = list[Fix]()
        for fix in memory or ():
            then = between(at.path, fix.time_ns)
            if fix.time_ns > at.time_ns or (at.camera is not None and then is None):
                continue
            antenna, late_s = at.rig.rig_from(fix.sensor).translation, (at.time_ns - fix.time_ns) * 1e-9
            covariance, relative, last = fix.covariance, Pose(), at.last
            if at.camera is not None and then is not None:
                relative = at.camera.inverse() @ then
            elif last is not None:
                speed = last.local_from_rig.rotation.T @ last.velocity * np.exp(-last.log_scale)
                relative = Pose(translation=-late_s * (at.camera_from_rig.rotation @ speed))
                covariance = covariance + np.eye(3) * (0.2 * late_s * float(np.linalg.norm(last.velocity))) ** 2
            found.append(Fix(fix.xyz_in_local, covariance, antenna, relative))
        return tuple(found) or None, tuple(fix for fix in memory or () if fix.time_ns > at.time_ns)

    def factors(self, before: Node | None, now: Node, frames: GraphFrames) -> list[Factor]:
        return [self._factor(fix, now, frames) for fix in fixes_of(now)]

    def _factor(self, fix: Fix, node: Node, frames: GraphFrames) -> Factor:
        """Of an antenna at the time of the fix, by the motion of the images from there to the node."""
        import gtsam

        antenna = frames.camera_from_rig.apply(fix.antenna_in_rig)
        antenna = fix.camera_from_then.scaled(np.exp(node.log_scale)).apply(antenna)
        arm = (frames.rig_from_body.inverse() @ frames.camera_from_rig.inverse()).apply(antenna)
        factor = gtsam.GPSFactorArm(POSE.key(node), fix.xyz_in_local, arm, frames.loss.noise(fix.covariance))
        return Factor(self.name, factor, node.number, 3, frames.loss)


KIND = GnssKind()
