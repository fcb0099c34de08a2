"""Reads `--sensors FILE.yaml`: the files of other sensors than the cameras, their poses on the rig, and their noise.

Each entry is a sensor by name, as in a rig.yaml (`sensor`: its kind; `rig_from_NAME`; its noise), and

    file: imu.csv               # from the YAML file's folder; a table (see io.sensor_tables), NMEA, or KITTI's oxts
    columns: {time_s: Time}     # the usual names of columns to the file's, where they differ
    clock_offset_s: 0.52        # added to its times, which gives those of the frames
    sigma_m: 0.5                # of GNSS fixes without standard deviations
    scan_s: 0.1                 # from the first beam of a laser scan to the last, of tables of ranges
    origin: [49.0, 8.4, 116]    # latitude, longitude [deg] and height [m] of the local frame; default: the first fix

Without `file` it is the sensor of that name that lies in or beside the source (see `recorded_sensors`), whose pose and
noise count where the entry has none. Of an IMU all samples between two frames are one measurement.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from ispom.errors import InputError
from ispom.io.mapping import finite_numbers, read_mapping
from ispom.io.rig import sensor_of
from ispom.io.sensor_tables import read_measurements
from ispom.io.timed_points import holds_points, read_timed_points
from ispom.io.values import MAX_TIME_S, number, sensor_name
from ispom.plausibility.times import time_doubts
from ispom.sensors import SENSOR_KINDS
from ispom.sensors.gnss import MAX_SIGMA, MIN_SIGMA
from ispom.sensors.kind import FileOptions, Readings
from ispom.sequences.recorded_sensors import RecordedSensor, measurements_of
from ispom.sequences.sensor_doubts import file_kinds, frames_ns_of, mount_doubts, sensor_doubts
from ispom.types import Found, Kind, Measurement, Rig, Sensor, Sequence

OWN = ("file", "columns", "clock_offset_s", "sigma_m", "origin", "scan_s")
"""Entries that a rig.yaml does not have."""
OF_FILES = ("columns", "origin", "scan_s")
"""Those that go with `file`."""
MAX_HEIGHT_M = 1e6
MAX_SCAN_S = 10.0
"""Longest duration of a laser scan."""
NOWHERE = {"translation_m": [0.0, 0.0, 0.0], "rotation_xyzw": [0.0, 0.0, 0.0, 1.0]}


def with_sensors(sequence: Sequence, path: Path, own: Iterable[RecordedSensor] = ()) -> Sequence:
    """Returns the sequence with the measurements of the sensors of a YAML file; `own` are those of the source.

    Raises InputError that names the file, entry or line that is wrong, and where a sensor measured before or after the
    frames only. What is likely a mistake, and a gap of a sensor as long as the sequence, are among its notes.
    """
    if sequence.grow is not None:
        raise InputError(f"--sensors {path}: a live camera takes in no files of other sensors: leave it out")
    sensors, measurements, notes = dict[str, Sensor](), list[Measurement](), list[str]()
    readings, found = dict[str, Readings](), list[Found]()
    frames_ns, beside = sequence.times_ns, {each.name: each for each in own}
    for name, given in read_mapping(path).items():
        if not isinstance(given, dict) or given.get("sensor", name) not in file_kinds():
            known = ", ".join(file_kinds())
            raise InputError(f"{path}: {str(name)[:40]} is no sensor of the kinds {known}: give `sensor` and `file`")
        entry = {"sensor": name, **given}
        _require_free(path, sensor_name(str(path), name), entry["sensor"], sequence)
        if entry.get("file") is None and name in beside:
            recorded = beside[name]
            sensors[name] = _completed(path, name, entry, recorded, sequence.rig)
            read, where = _of_source(path, name, entry, recorded), recorded.where
        else:
            sensors[name] = sensor_of(path, name, {k: v for k, v in entry.items() if k not in OWN})
            read = _read(path, name, entry, beside)
            where = str(path.parent / entry["file"])
        readings[name] = read
        found.append(Found(entry["sensor"], where, True, f"by {path}"))
        inside = list(measurements_of(name, read, frames_ns))
        if not inside:
            first, last = frames_ns[[0, -1]] * 1e-9
            measured = f"{read.times_ns[0] * 1e-9:.3f} to {read.times_ns[-1] * 1e-9:.3f} s" if len(read) else "nothing"
            about = (
                f"{path}: {name} measured nothing within the frames' {first:.3f} to {last:.3f} s (it has {measured})"
            )
            if not len(read) or read.times_ns[-1] < frames_ns[0] or read.times_ns[0] > frames_ns[-1]:
                doubts = time_doubts(f"{path}: {name}", SENSOR_KINDS.get(read.kind).rates, read.times_ns, frames_ns)
                unit = " (or the unit of its times)" if any(doubt.key == "time_unit" for doubt in doubts) else ""
                raise InputError(f"{about}: correct its file or its clock_offset_s{unit}")
            notes.append(f"{about}.")
        measurements += inside
    rig = sequence.rig.changed(**sensors)
    doubts = sensor_doubts(lambda name: f"{path}: {name}", rig, readings, frames_ns_of(sequence))
    notes += [*doubts, *mount_doubts(str(path), Rig(sensors))]
    named = {each.where for each in found}
    found += [
        Found(each.sensor.kind, each.where, False, f"is not used, as {path} does not name it")
        for each in beside.values()
        if each.where not in named
    ]
    return replace(sequence, rig=rig).with_found(found).with_notes(notes).with_measurements(measurements)


def _require_free(path: Path, name: str, kind: Kind, sequence: Sequence) -> None:
    """Raises InputError where the sequence has a sensor of this name that is of another kind, or measured, too."""
    there = sequence.rig.sensors.get(name)
    if there is not None and (there.kind != kind or kind in sequence.kinds):
        raise InputError(f"{path}: {name} is a sensor of the source already: choose another name, and give `sensor`")


def _completed(path: Path, name: str, entry: dict[Any, Any], recorded: RecordedSensor, rig: Rig) -> Sensor:
    """Returns the sensor of the source with the pose and the noise of its entry, or else its own."""
    if entry["sensor"] != recorded.sensor.kind:
        kind = recorded.sensor.kind
        raise InputError(f"{path}: {name} of the source is of the kind {kind}: give `sensor: {kind}`, or a `file`")
    pose_key = f"rig_from_{name}"
    keeps = recorded.placed and entry.get(pose_key) is None
    given = {key: value for key, value in entry.items() if key not in OWN} | ({pose_key: NOWHERE} if keeps else {})
    stated = sensor_of(path, name, given)
    pose = stated.rig_from_sensor
    if keeps:
        pose = recorded.placed_on(rig).rig_from_sensor
    noise = {f.name: getattr(stated, f.name) for f in fields(stated) if f.name in entry}
    return replace(recorded.sensor, rig_from_sensor=pose, **noise)


def _of_source(path: Path, name: str, entry: dict[Any, Any], recorded: RecordedSensor) -> Readings:
    """Returns all that a sensor of the source measured, on the clock of the frames."""
    if wrong := [key for key in OF_FILES if entry.get(key) is not None]:
        raise InputError(f"{path}: {name}.{wrong[0]} goes with `file`: name the file, or leave it out")
    read = recorded.read()
    if (sigma_m := _sigma_m(path, name, entry)) is not None and "sigma" in read.values:
        read = replace(read, values={**read.values, "sigma": np.full_like(read.values["sigma"], sigma_m)})
    return _on_clock(path, name, entry, read)


def _read(path: Path, name: str, entry: dict[Any, Any], beside: Mapping[str, RecordedSensor]) -> Readings:
    """Returns all that one sensor measured, on the clock of the frames."""
    given = entry.get("file")
    if not isinstance(given, str):
        own = f", or one of the source's own ({', '.join(beside)}) as the entry" if beside else ""
        raise InputError(f"{path}: {name}.file is missing: name the file that holds its measurements{own}")
    columns = entry.get("columns")
    if columns is not None and not (isinstance(columns, dict) and all(isinstance(v, str) for v in columns.values())):
        raise InputError(f"{path}: {name}.columns must map usual names to those of the file: correct it")
    origin = None
    if entry.get("origin") is not None:
        bounds = ((-90, 90), (-360, 360), (-MAX_HEIGHT_M, MAX_HEIGHT_M))
        values = finite_numbers(path, f"{name}.origin", entry["origin"], 3)
        origin = np.array([number(f"{path}: {name}.origin", v, *b) for v, b in zip(values, bounds, strict=True)])
    scan_s = _number(path, name, entry, "scan_s", 0.0, 0.0, MAX_SCAN_S)
    options = FileOptions(f"{path}: {name}", _sigma_m(path, name, entry), origin, scan_s)
    kind, file = SENSOR_KINDS.get(entry["sensor"]), path.parent / given
    if kind.takes_points and not columns and holds_points(file):
        read = kind.readings_of_points(read_timed_points(file))
    else:
        read = kind.readings(read_measurements(file, columns), options)
    return _on_clock(path, name, entry, read)


def _on_clock(path: Path, name: str, entry: dict[Any, Any], read: Readings) -> Readings:
    """Returns the readings with the entry's clock_offset_s added to their times."""
    offset_s = _number(path, name, entry, "clock_offset_s", 0.0, -MAX_TIME_S, MAX_TIME_S)
    for end_ns in read.times_ns[[0, -1]].tolist() if len(read.times_ns) else ():
        number(f"{path}: {name}, a time with its clock_offset_s", offset_s + end_ns * 1e-9, -MAX_TIME_S, MAX_TIME_S)
    return replace(read, times_ns=read.times_ns + round(1e9 * offset_s))


def _sigma_m(path: Path, name: str, entry: dict[Any, Any]) -> float | None:
    return _number(path, name, entry, "sigma_m", None, MIN_SIGMA, MAX_SIGMA)


def _number(path: Path, name: str, entry: dict[Any, Any], key: str, default: Any, least: float, most: float) -> Any:
    if entry.get(key) is None:
        return default
    return finite_numbers(path, f"{name}.{key}", [entry[key]], 1, least, most)[0]
