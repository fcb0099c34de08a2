"""What in the measurements of a sequence's sensors, and in their mounts, is likely a mistake."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.plausibility import Doubt
from ispom.plausibility.gnss import mirrored_doubts
from ispom.plausibility.mounts import far_doubts, gravity_doubts
from ispom.plausibility.times import time_doubts
from ispom.plausibility.wheel import still_doubts
from ispom.sensors import SENSOR_KINDS
from ispom.sensors.kind import Readings
from ispom.types import FRAME_KINDS, FrameName, Kind, Measurement, Rig, Sequence

LEAST_SHARE = 0.9
"""Least ratio of the mean specific force to its mean length with which it is gravity: the unit hardly turned."""


DISTURBING = ("time_unit", "imu_swapped", "imu_all_zero", "gyroscope_in_degrees", "gnss_all_zero", "gnss_jump")
"""Doubts about sensors that are not compared with others then: one mistake has one note."""


def file_kinds() -> tuple[Kind, ...]:
    """Returns the kinds of sensors whose files are read; their measurements are small enough to be loaded together."""
    return tuple(name for name, kind in SENSOR_KINDS.items().items() if kind.has_files)


def readings_of(sequence: Sequence) -> dict[FrameName, Readings]:
    """Returns the readings of each IMU, receiver and odometer, by its name; loads no images and no scans."""
    found, kinds = dict[FrameName, list[Measurement]](), frozenset(file_kinds())
    for i, kind in enumerate(sequence.kinds):
        if kind in kinds:
            measured = sequence.load(i)
            found.setdefault(str(getattr(measured, "sensor", kind)), []).append(measured)
    return {name: _collected(measured) for name, measured in found.items()}


def _collected(measured: list[Measurement]) -> Readings:
    kind = SENSOR_KINDS.get(measured[0].kind)
    if isinstance(measured[0], kind.measurement):
        return kind.collected(measured)
    return Readings(kind.name, np.array([m.time_ns for m in measured], np.int64))  # a package's own class of this kind


def frames_ns_of(sequence: Sequence) -> NDArray[np.int64]:
    """Returns the times of the images (N,)."""
    return sequence.times_ns[np.array([kind in FRAME_KINDS for kind in sequence.kinds], bool)]


def sensor_doubts(
    where: Callable[[FrameName], str], rig: Rig, readings: Mapping[FrameName, Readings], frames_ns: NDArray[np.int64]
) -> tuple[Doubt, ...]:
    """Returns doubts about what sensors measured, by themselves and against each other, and about their mounts.

    `where` begins a sentence about a sensor.
    """
    out: list[Doubt] = []
    for name, each in readings.items():
        if not each.values:
            continue
        kind = SENSOR_KINDS.get(each.kind)
        of_times = time_doubts(where(name), kind.rates, each.times_ns, frames_ns)
        in_time = not any(doubt.key == "time_unit" for doubt in of_times)
        out += [*of_times, *(kind.doubts(where(name), each) if in_time else ())]
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
    """Returns doubts about the places of all sensors; those of a pair are seen by its baseline."""
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


def _upward(readings: Mapping[FrameName, Readings]) -> dict[FrameName, Array]:
    """Upward in the frame of each IMU that hardly turns: the direction of its mean specific force."""
    found = {}
    for name, each in readings.items():
        if each.kind == "imu" and len(each.values.get("forces", ())):
            forces = each.values["forces"]
            mean, length = forces.mean(axis=0), np.linalg.norm(forces, axis=1).mean()
            if length > 0 and np.linalg.norm(mean) > LEAST_SHARE * length:
                found[name] = mean / np.linalg.norm(mean)
    return found
