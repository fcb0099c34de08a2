"""Sensors other than cameras that lie in or beside a recording: they join its stream without a file that names them.

One of each kind is used by itself: the first whose pose on the rig is known and whose values are sound. What is not
used is named with the reason, and with the entry that makes it usable in a file for `--sensors` (see `sensors`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from ispom.errors import InputError
from ispom.sequences.readings import DISTURBING, Readings, frames_ns_of, measured_within, mount_doubts, sensor_doubts
from ispom.types import Found, FrameName, Imu, Measurement, Rig, Sensor, Sequence

AUTO, NONE = Path("auto"), Path("none")
"""Choices of `--sensors` that are no file: those that lie in or beside the source, or none."""
POSE = "{translation_m: [x, y, z], rotation_xyzw: [x, y, z, w]}"


@dataclass(frozen=True, eq=False)
class OwnSensor:
    """A sensor that lies in or beside a recording."""

    name: FrameName
    """That of its kind, as a rule."""
    where: str
    """The file, the folder, or the topic of a bag."""
    sensor: Sensor
    """With its noise; its pose is that in the left camera of the recording, where it is known."""
    read: Callable[[], Readings]
    """Reads all that it measured, on the clock of the frames. Raises InputError."""
    said: str = ""
    """Where its pose and its noise are from, and what was decided."""
    missing: str = ""
    """Why it is not used by itself, as the rest of a sentence; empty where nothing is missing."""
    placed: bool = True
    """Whether its pose is known."""

    @property
    def entry(self) -> str:
        """The entry of a file for `--sensors` that makes it usable."""
        kind = "" if self.name == self.sensor.kind else f"sensor: {self.sensor.kind}"
        pose = "" if self.placed else f"rig_from_{self.name}: {POSE}"
        return f"{self.name}: {{{', '.join(part for part in (kind, pose) if part)}}}"


def imu_said(of_pose: str, noise: dict[str, float], of_noise: str) -> str:
    """Says where the pose of an IMU is from, empty where it is not known, and its noise; the usual noise is a decision
    that is said."""
    if noise and of_noise == of_pose:
        return f"pose and noise of {of_pose}"
    pose = f"pose of {of_pose}, " if of_pose else ""
    if noise:
        return f"{pose}noise of {of_noise}"
    usual = f"{Imu.gyroscope_noise:g} rad/s/sqrt(Hz) and {Imu.accelerometer_noise:g} m/s^2/sqrt(Hz)"
    return f"{pose}nothing states its noise: the usual one is taken ({usual})"


def left_camera(rig: Rig) -> FrameName:
    """Returns the name of the camera of the rig that is the left one of a recording."""
    return "left" if rig.has_stereo else "video"


def with_own_sensors(sequence: Sequence, own: Iterable[OwnSensor]) -> Sequence:
    """Returns the sequence with the measurements of those of its own sensors that can be used; the others are named."""
    sensors, measurements, found = dict[str, Sensor](), list[Measurement](), list[Found]()
    used = dict[str, OwnSensor]()
    frames_ns, kept = frames_ns_of(sequence), dict[str, Readings]()
    rig_from_left = sequence.rig.rig_from(left_camera(sequence.rig))
    for each in own:
        kind, why = each.sensor.kind, each.missing
        if why:
            why = f"{why}; to use it, write `{each.entry}` to a file, and give that by --sensors"
        elif kind in used:
            why = f"is not used: {used[kind].where} is, and methods take one {kind}; to change that, write "
            why += f"`{each.entry}` to a file, and give that by --sensors"
        else:
            sensor = replace(each.sensor, rig_from_sensor=rig_from_left @ each.sensor.rig_from_sensor)
            try:
                readings, why, inside = _sound(each, sensor, sequence)
            except InputError as fault:
                readings, why, inside = None, f"is not used: {fault.args[0]}", []
            if readings is not None and not why:
                used[kind], sensors[each.name], kept[each.name] = each, sensor, readings
                measurements += inside
        found.append(Found(kind, each.where, not why, why or each.said))
    if not sensors:
        return sequence.with_found(found)
    rig = sequence.rig.changed(**sensors)
    places = {each.name: each.where for each in used.values()}
    notes: list[str] = [*sensor_doubts(lambda name: places.get(name, name), rig, kept, frames_ns)]
    notes += mount_doubts(sequence.name, Rig(sensors))
    return replace(sequence, rig=rig).with_found(found).with_notes(notes).with_measurements(measurements)


def _sound(each: OwnSensor, sensor: Sensor, sequence: Sequence) -> tuple[Readings, str, list[Measurement]]:
    """Returns what a sensor measured, why it is not used ("" where it is), and its measurements within the frames."""
    readings, frames_ns = each.read(), frames_ns_of(sequence)
    if not len(readings):
        return readings, "holds no measurements", []
    inside = list(measured_within(each.name, readings, frames_ns))
    if not inside:
        first, last = frames_ns[[0, -1]] * 1e-9
        times_s = readings.times_ns[[0, -1]] * 1e-9
        why = f"is not used: it measured from {times_s[0]:.3f} to {times_s[1]:.3f} s, nothing within the frames' "
        return readings, f"{why}{first:.3f} to {last:.3f} s", []
    rig = sequence.rig.changed(**{each.name: sensor})
    doubts = sensor_doubts(lambda _: each.where, rig, {each.name: readings}, frames_ns)
    wrong = next((str(doubt) for doubt in doubts if doubt.key in DISTURBING), "")
    return readings, f"is not used: {wrong}" if wrong else "", inside
