"""All measurements of sensors other than cameras, one array per sensor, and likely mistakes in them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.plausibility import Doubt
from ispom.plausibility.gnss import geodetic_doubts, gnss_doubts, mirrored_doubts, null_fixes
from ispom.plausibility.imu import imu_doubts
from ispom.plausibility.mounts import far_doubts, gravity_doubts
from ispom.plausibility.times import BEFORE_NS, time_doubts
from ispom.plausibility.wheel import still_doubts, wheel_doubts
from ispom.types import FRAME_KINDS, FrameName, GnssFix, ImuSamples, Kind, Measurement, Rig, Sequence, WheelIncrement

READ = ("imu", "gnss", "wheel")
"""Kinds of measurements that are small enough to be loaded at once."""
MIN_GRAVITY_SHARE = 0.9
"""Least ratio of the length of the mean specific force to its mean length, for a unit that hardly rotated: the mean is
then gravity."""


DISTURBING = ("time_unit", "imu_swapped", "imu_all_zero", "gyroscope_in_degrees", "gnss_all_zero", "gnss_jump")
"""Doubts after which a sensor is not compared with others, so that one mistake has one note."""


@dataclass(frozen=True, eq=False)
class Readings:
    """All measurements of one sensor, in the order of time."""

    kind: Kind
    times_ns: NDArray[np.int64]
    """(N,) times; for wheels (N + 1,), with the start of the first increment."""
    values: Mapping[str, Array] = field(default_factory=dict)
    """For an IMU `rates` and `forces` (N, 3). For GNSS `xyz` and `sigma` (N, 3), and `geodetic` (N, 3), the original
    latitude, longitude and height, if there are any. For wheels `distances` and optionally `turns` (N,). Else empty."""

    def __len__(self) -> int:
        return len(self.times_ns) - (self.kind == "wheel" and len(self.times_ns) > 0)

    @staticmethod
    def of(measured: list[Measurement]) -> Readings:
        """Returns the readings of one sensor's measurements, which have one kind."""
        first = measured[0]
        if isinstance(first, ImuSamples):
            samples = [m for m in measured if isinstance(m, ImuSamples)]
            values = {
                "rates": np.concatenate([m.angular_velocity_rad_s for m in samples]),
                "forces": np.concatenate([m.specific_force_m_s2 for m in samples]),
            }
            return Readings(first.kind, np.concatenate([m.times_ns for m in samples]), values)
        times_ns = np.array([m.time_ns for m in measured], np.int64)
        if isinstance(first, GnssFix):
            fixes = [m for m in measured if isinstance(m, GnssFix)]
            sigma = np.sqrt(np.stack([np.diag(m.covariance) for m in fixes]))
            return Readings(first.kind, times_ns, {"xyz": np.stack([m.xyz_in_local for m in fixes]), "sigma": sigma})
        if isinstance(first, WheelIncrement):
            wheels = [m for m in measured if isinstance(m, WheelIncrement)]
            values = {"distances": np.array([m.distance_m for m in wheels])}
            turns = [m.turned_rad for m in wheels if m.turned_rad is not None]
            values |= {"turns": np.array(turns)} if len(turns) == len(wheels) else {}
            return Readings(first.kind, np.append(wheels[0].since_ns, times_ns), values)
        return Readings(first.kind, times_ns)  # a package's own measurements of one of these kinds


def readings_of(sequence: Sequence) -> dict[FrameName, Readings]:
    """Returns the readings of each IMU, receiver and odometer, by its name; loads no images and no scans."""
    found: dict[FrameName, list[Measurement]] = {}
    for i, kind in enumerate(sequence.kinds):
        if kind in READ:
            measured = sequence.load(i)
            found.setdefault(str(getattr(measured, "sensor", kind)), []).append(measured)
    return {name: Readings.of(measured) for name, measured in found.items()}


def frames_ns_of(sequence: Sequence) -> NDArray[np.int64]:
    """Returns the times of the images (N,)."""
    return sequence.times_ns[np.array([kind in FRAME_KINDS for kind in sequence.kinds], bool)]


def sensor_doubts(
    where: Callable[[FrameName], str], rig: Rig, readings: Mapping[FrameName, Readings], frames_ns: NDArray[np.int64]
) -> tuple[Doubt, ...]:
    """Returns doubts about the measurements of single sensors, about their consistency, and about the mounts.

    `where` returns the beginning of a sentence about a sensor.
    """
    out: list[Doubt] = []
    for name, each in readings.items():
        of_times = time_doubts(where(name), each.kind, each.times_ns, frames_ns) if each.values else ()
        in_time = not any(doubt.key == "time_unit" for doubt in of_times)
        out += [*of_times, *(_of_values(where(name), each) if in_time else ())]
    imu = next((each for each in readings.values() if each.kind == "imu"), None)
    for name, each in readings.items():
        sound = not any(doubt.key in DISTURBING for doubt in out)
        if each.kind == "gnss" and imu is not None and imu.values and each.values and sound:
            samples = imu.times_ns, imu.values["rates"], imu.values["forces"]
            out += mirrored_doubts(where(name), each.times_ns, each.values["xyz"], each.values["sigma"], samples)
        if each.kind == "wheel" and each.values:
            for fixes in (other.values for other in readings.values() if other.kind == "gnss" and other.values):
                out += still_doubts(where(name), each.values["distances"], fixes["xyz"], fixes["sigma"])
    if not any(doubt.key.startswith(("imu_swapped", "accelerometer")) for doubt in out):
        out += gravity_doubts(where("the rig"), rig, _upward(readings))
    return tuple(out)


def mount_doubts(where: str, rig: Rig) -> tuple[Doubt, ...]:
    """Returns doubts about the positions of all sensors except a pair's, which are checked by its baseline."""
    pair = {"left", "right"} if rig.has_stereo else set()
    return tuple(
        doubt
        for name, sensor in rig.sensors.items()
        if name not in pair
        for doubt in far_doubts(where, name, sensor.rig_from_sensor)
    )


def with_doubts(sequence: Sequence, where: str) -> Sequence:
    """Returns the sequence with doubts about its own sensors and their mounts among its notes."""
    readings = readings_of(sequence)
    found = mount_doubts(where, sequence.rig)
    if readings:
        found += sensor_doubts(lambda n: f"{where}: {n}", sequence.rig, readings, frames_ns_of(sequence))
    return sequence.with_notes(found)


def impossible(doubts: tuple[Doubt, ...]) -> InputError:
    """Returns the error of values that cannot be used at all."""
    return InputError(str(doubts[0]).rstrip("."))


def _of_values(where: str, each: Readings) -> tuple[Doubt, ...]:
    values = each.values
    if each.kind == "imu" and values:
        return imu_doubts(where, each.times_ns, values["rates"], values["forces"])
    if each.kind == "gnss" and values:
        geodetic = values.get("geodetic")
        first, null = ((), None) if geodetic is None else (geodetic_doubts(where, geodetic)[0], null_fixes(geodetic))
        return (*first, *gnss_doubts(where, each.times_ns, values["xyz"], values["sigma"], null))
    if each.kind == "wheel" and values:
        return wheel_doubts(where, each.times_ns, values["distances"], values.get("turns"))
    return ()


def _upward(readings: Mapping[FrameName, Readings]) -> dict[FrameName, Array]:
    """Returns the upward direction in the frame of each IMU that hardly rotates: that of its mean specific force."""
    found = {}
    for name, each in readings.items():
        if each.kind == "imu" and len(each.values.get("forces", ())):
            forces = each.values["forces"]
            mean, length = forces.mean(axis=0), np.linalg.norm(forces, axis=1).mean()
            if length > 0 and np.linalg.norm(mean) > MIN_GRAVITY_SHARE * length:
                found[name] = mean / np.linalg.norm(mean)
    return found


def measured_within(name: str, found: Readings, frames_ns: NDArray[np.int64]) -> Iterator[Measurement]:
    """Yields the measurements of one sensor between the first and the last frame, in the order of time."""
    times_ns, values = found.times_ns, found.values
    if found.kind == "imu":
        yield from imu_measurements(times_ns, values["rates"], values["forces"], frames_ns, name)
        return
    ends_ns = times_ns[1:] if found.kind == "wheel" else times_ns
    used = (ends_ns >= frames_ns[0] - BEFORE_NS) & (ends_ns <= frames_ns[-1])
    if "geodetic" in values:
        used &= ~null_fixes(values["geodetic"])
    for i in np.flatnonzero(used).tolist():
        if found.kind == "gnss":
            yield GnssFix(int(times_ns[i]), values["xyz"][i], np.diag(values["sigma"][i] ** 2), name)
        else:
            turn = float(values["turns"][i]) if "turns" in values else None
            yield WheelIncrement(int(ends_ns[i]), int(times_ns[i]), float(values["distances"][i]), turn, name)


def imu_measurements(
    times_ns: NDArray[np.int64], rates: Array, forces: Array, frames_ns: NDArray[np.int64], name: str
) -> Iterator[ImuSamples]:
    """Yields the samples from one frame to the next; those before BEFORE_NS and after the last frame are skipped."""
    keep = (times_ns >= frames_ns[0] - BEFORE_NS) & (times_ns <= frames_ns[-1])
    times_ns, rates, forces = times_ns[keep], rates[keep], forces[keep]
    part = np.searchsorted(frames_ns, times_ns)
    for index in np.split(np.arange(len(times_ns)), np.flatnonzero(np.diff(part)) + 1):
        if len(index):
            yield ImuSamples(int(times_ns[index[-1]]), times_ns[index], rates[index], forces[index], name)
