"""Sensors other than cameras that lie in or beside a recording: they join its stream without a file that names them.

One of each kind is used by itself: the first whose pose on the rig is known and whose values are sound. What is not
used is named with the reason, and with the entry that makes it usable in a file for `--sensors` (see `sensors_yaml`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.sensors import SENSOR_KINDS
from ispom.sensors.kind import Readings
from ispom.sequences.sensor_doubts import frames_ns_of, mount_doubts, sensor_doubts
from ispom.types import Found, FrameName, Imu, Measurement, Rig, Sensor, Sequence

AUTO, NONE = Path("auto"), Path("none")
"""Choices of `--sensors` that are no file: those that lie in or beside the source, or none."""
UNSOUND = (
    *("time_unit", "imu_swapped", "imu_all_zero", "gyroscope_in_degrees", "gnss_all_zero", "gnss_earth_centred"),
    *("accelerometer_in_g", "accelerometer_too_large", "accelerometer_without_gravity"),
    *("latitude_longitude_swapped", "latitude_in_radians", "latitude_in_minutes"),
    *("wheel_unit", "wheel_cumulative", "wheel_turn_in_degrees"),
)
"""Doubts about values that no method can use, so that the sensor is not used unasked."""
POSE = "{translation_m: [x, y, z], rotation_xyzw: [x, y, z, w]}"


@dataclass(frozen=True, eq=False)
class RecordedSensor:
    """A sensor that lies in or beside a recording."""

    name: FrameName
    """That of its kind, as a rule."""
    where: str
    """The file, the folder, or the topic of a bag."""
    sensor: Sensor
    """With its noise; its pose is that in the left camera of the recording, where it is known."""
    read: Callable[[], Readings]
    """Reads all that it measured, on the clock of the frames. Raises InputError."""
    origin: str = ""
    """Where its pose and its noise are from, and what was decided."""
    missing: str = ""
    """Why it is not used by itself, as the rest of a sentence; empty where nothing is missing."""
    placed: bool = True
    """Whether its pose is known."""

    def placed_on(self, rig: Rig) -> Sensor:
        """Returns the sensor with its pose on the rig of the recording."""
        rig_from_left = rig.rig_from("left" if rig.has_stereo else "video")
        return replace(self.sensor, rig_from_sensor=rig_from_left @ self.sensor.rig_from_sensor)

    @property
    def remedy(self) -> str:
        """What to do to use it, with the entry of a file for `--sensors`."""
        kind = "" if self.name == self.sensor.kind else f"sensor: {self.sensor.kind}"
        pose = "" if self.placed else f"rig_from_{self.name}: {POSE}"
        entry = f"{self.name}: {{{', '.join(part for part in (kind, pose) if part)}}}"
        return f"write `{entry}` to a file, and give that by --sensors"


def imu_origin(of_pose: str, noise: Imu | None, of_noise: str) -> str:
    """Returns where the pose of an IMU (`of_pose`, empty where it is not known) and its noise are from, in words."""
    if noise and of_noise == of_pose:
        return f"pose and noise of {of_pose}"
    pose = f"pose of {of_pose}, " if of_pose else ""
    if noise:
        return f"{pose}noise of {of_noise}"
    usual = f"{Imu.gyroscope_noise:g} rad/s/sqrt(Hz) and {Imu.accelerometer_noise:g} m/s^2/sqrt(Hz)"
    return f"{pose}nothing states its noise: the usual one is taken ({usual})"


def measurements_of(name: FrameName, found: Readings, frames_ns: NDArray[np.int64]) -> Iterator[Measurement]:
    """Yields what a sensor measured within the time of the frames (N,), in the order of time."""
    return SENSOR_KINDS.get(found.kind).measurements(found, frames_ns, name)


def with_recorded_sensors(sequence: Sequence, own: Iterable[RecordedSensor]) -> Sequence:
    """Returns the sequence with the measurements of those of its own sensors that can be used; the others are named."""
    listed, frames_ns = tuple(own), frames_ns_of(sequence)
    reasons = {i: f"{each.missing}; to use it, {each.remedy}" for i, each in enumerate(listed) if each.missing}
    read = dict[int, Readings]()
    while True:
        chosen = _first_of_each_kind(listed, reasons, read, frames_ns)
        sensors = {listed[i].name: listed[i].placed_on(sequence.rig) for i in chosen}
        where = {"the rig": "the rig"} | {listed[i].name: listed[i].where for i in chosen}
        rig = sequence.rig.changed(**sensors)
        readings = {listed[i].name: read[i] for i in chosen}
        doubts = sensor_doubts(where.__getitem__, rig, readings, frames_ns) if chosen else ()
        wrong = {i: str(d) for i in chosen for d in doubts if d.key in UNSOUND and d.startswith(listed[i].where)}
        if not wrong:
            break
        reasons |= {i: f"is not used: {doubt}" for i, doubt in wrong.items()}
    found = list[Found]()
    for i, each in enumerate(listed):
        why = reasons.get(i, "")
        if not why and i not in chosen:
            other = next(listed[k].where for k in chosen if listed[k].sensor.kind == each.sensor.kind)
            why = f"is not used: {other} is, and methods take one {each.sensor.kind}; to change that, {each.remedy}"
        found.append(Found(each.sensor.kind, each.where, not why, why or each.origin))
    if not chosen:
        return sequence.with_found(found)
    notes = (*doubts, *mount_doubts(sequence.name, Rig(sensors)))
    measured = (m for i in chosen for m in measurements_of(listed[i].name, read[i], frames_ns))
    beside = frozenset(listed[i].sensor.kind for i in chosen)
    sequence = replace(sequence, rig=rig, beside=beside).with_found(found).with_notes(notes)
    return sequence.with_measurements(measured)


def _first_of_each_kind(
    listed: tuple[RecordedSensor, ...], reasons: dict[int, str], read: dict[int, Readings], frames_ns: NDArray[np.int64]
) -> list[int]:
    """Returns the first of each kind that has measurements within the frames; adds what was read to `read`, and to
    `reasons` why the others are not used."""
    chosen = dict[str, int]()
    for i, each in enumerate(listed):
        if i in reasons or each.sensor.kind in chosen:
            continue
        try:
            read[i] = readings = read[i] if i in read else each.read()
        except InputError as fault:
            reasons[i] = f"is not used: {fault.args[0]}"
            continue
        if not len(readings):
            reasons[i] = "is not used: it has no measurements"
        elif next(measurements_of(each.name, readings, frames_ns), None) is None:
            (first, last), (begin, end) = readings.times_ns[[0, -1]] * 1e-9, frames_ns[[0, -1]] * 1e-9
            when = f"it measured from {first:.3f} to {last:.3f} s, nothing within the frames'"
            reasons[i] = f"is not used: {when} {begin:.3f} to {end:.3f} s"
        else:
            chosen[each.sensor.kind] = i
    return list(chosen.values())
