"""Sensors other than the cameras of a sequence: a YAML file says which files hold what they measured.

Each entry is a sensor by name, as in a rig.yaml (`sensor`: its kind; `rig_from_NAME`; its noise), and

    file: imu.csv               # from the YAML file's folder; a table (see io.sensor_tables), NMEA, or KITTI's oxts
    columns: {time_s: Time}     # the usual names of columns to the file's, where they differ
    clock_offset_s: 0.52        # added to its times, which gives those of the frames
    sigma_m: 0.5                # of GNSS fixes without standard deviations
    origin: [49.0, 8.4, 116]    # latitude, longitude [deg] and height [m] of the local frame; default: the first fix

Of an IMU all samples between two frames are one measurement.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.files import is_folder
from ispom.io.kitti import read_oxts_values
from ispom.io.mapping import finite_numbers, read_mapping
from ispom.io.nmea import read_gga
from ispom.io.rig import sensor_of
from ispom.io.sensor_tables import GEODETIC, IMU, LOCAL, gnss_sigma, read_table
from ispom.io.values import LEAST_SIGMA, MAX_TIME_S, MOST_SIGMA, number, sensor_name
from ispom.plausibility.gnss import geodetic_doubts, null_fixes
from ispom.plausibility.times import BEFORE_NS, time_doubts
from ispom.sequences.readings import Readings, frames_ns_of, impossible, mount_doubts, sensor_doubts
from ispom.types import GnssFix, ImuSamples, Kind, Measurement, Rig, Sensor, Sequence, WheelIncrement

KINDS = ("imu", "gnss", "wheel")
OWN = ("file", "columns", "clock_offset_s", "sigma_m", "origin")
"""Entries that a rig.yaml does not have."""
NMEA_SUFFIXES = (".nmea", ".nma")
MAX_HEIGHT_M = 1e6
OXTS_GYROSCOPE, OXTS_ACCELEROMETER, OXTS_ACCURACY = slice(17, 20), slice(11, 14), 23
"""Columns of a line of KITTI's oxts: rates and accelerations about the unit's x, y, z, and the position's accuracy."""


def with_sensors(sequence: Sequence, path: Path) -> Sequence:
    """Returns the sequence with the measurements of the sensors that a YAML file describes.

    Raises InputError that names the file, entry or line that is wrong, and where a sensor measured before or after the
    frames only. What is likely a mistake, and a gap of a sensor as long as the sequence, are among its notes.
    """
    if sequence.grow is not None:
        raise InputError(f"--sensors {path}: a live camera takes in no files of other sensors: leave it out")
    sensors, measurements, notes = dict[str, Sensor](), list[Measurement](), list[str]()
    readings = dict[str, Readings]()
    frames_ns = sequence.times_ns
    for name, given in read_mapping(path).items():
        if not isinstance(given, dict) or given.get("sensor", name) not in KINDS:
            known = ", ".join(KINDS)
            raise InputError(f"{path}: {str(name)[:40]} is no sensor of the kinds {known}: give `sensor` and `file`")
        entry = {"sensor": name, **given}
        _require_free(path, sensor_name(str(path), name), entry["sensor"], sequence)
        sensors[name] = sensor_of(path, name, {k: v for k, v in entry.items() if k not in OWN})
        found = _read(path, name, entry)
        readings[name] = found
        inside = list(_measured(name, found, frames_ns))
        if not inside:
            first, last = frames_ns[[0, -1]] * 1e-9
            measured = f"{found.times_ns[0] * 1e-9:.3f} to {found.times_ns[-1] * 1e-9:.3f} s"
            when = measured if len(found) else "nothing"
            about = f"{path}: {name} measured nothing within the frames' {first:.3f} to {last:.3f} s (it has {when})"
            if not len(found) or found.times_ns[-1] < frames_ns[0] or found.times_ns[0] > frames_ns[-1]:
                doubts = time_doubts(f"{path}: {name}", found.kind, found.times_ns, frames_ns)
                unit = " (or the unit of its times)" if any(doubt.key == "time_unit" for doubt in doubts) else ""
                raise InputError(f"{about}: correct its file or its clock_offset_s{unit}")
            notes.append(f"{about}.")
        measurements += inside
    rig = sequence.rig.changed(**sensors)
    doubts = sensor_doubts(lambda name: f"{path}: {name}", rig, readings, frames_ns_of(sequence))
    notes += [*doubts, *mount_doubts(str(path), Rig(sensors))]
    return replace(sequence, rig=rig).with_notes(notes).with_measurements(measurements)


def _require_free(path: Path, name: str, kind: Kind, sequence: Sequence) -> None:
    """Raises InputError where the sequence has a sensor of this name that is of another kind, or measured, too."""
    there = sequence.rig.sensors.get(name)
    if there is not None and (there.kind != kind or kind in sequence.kinds):
        raise InputError(f"{path}: {name} is a sensor of the source already: choose another name, and give `sensor`")


def _read(path: Path, name: str, entry: dict[Any, Any]) -> Readings:
    """Returns all that one sensor measured, on the clock of the frames."""
    given = entry.get("file")
    if not isinstance(given, str):
        raise InputError(f"{path}: {name}.file is missing: name the file that holds its measurements")
    columns = entry.get("columns")
    if columns is not None and not (isinstance(columns, dict) and all(isinstance(v, str) for v in columns.values())):
        raise InputError(f"{path}: {name}.columns must map usual names to those of the file: correct it")
    offset_s = _number(path, name, entry, "clock_offset_s", 0.0, -MAX_TIME_S, MAX_TIME_S)
    file, kind = path.parent / given, entry["sensor"]
    if kind == "gnss":
        times_ns, values = _fixes(path, name, entry, file, columns)
    elif kind == "wheel":
        table = read_table(file, columns)
        times_ns, values = table.times_ns, {"distances": table.stacked(("distance",))[1:, 0]}
        values |= {"turns": table.columns["turn"][1:]} if "turn" in table.columns else {}
    elif is_folder(file):
        times_ns, rows = read_oxts_values(file)
        values = {"rates": rows[:, OXTS_GYROSCOPE], "forces": rows[:, OXTS_ACCELEROMETER]}
    else:
        table = read_table(file, columns)
        times_ns, rows = table.times_ns, table.stacked(IMU)
        values = {"rates": rows[:, :3], "forces": rows[:, 3:]}
    for end_ns in times_ns[[0, -1]].tolist():
        number(f"{path}: {name}, a time with its clock_offset_s", offset_s + end_ns * 1e-9, -MAX_TIME_S, MAX_TIME_S)
    return Readings(kind, times_ns + round(1e9 * offset_s), values)


def _measured(name: str, found: Readings, frames_ns: NDArray[np.int64]) -> Iterator[Measurement]:
    """Yields what one sensor measured within the frames' time, in the order of time."""
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


def _fixes(
    path: Path, name: str, entry: dict[Any, Any], file: Path, columns: dict[str, str] | None
) -> tuple[NDArray[np.int64], dict[str, Array]]:
    """Returns times (N,), and by name local positions `xyz` (N, 3), their standard deviations `sigma` (N, 3), and
    perhaps what they were as latitude, longitude and height (`geodetic`, (N, 3))."""
    default = _number(path, name, entry, "sigma_m", None, LEAST_SIGMA, MOST_SIGMA)
    if is_folder(file):
        times_ns, values = read_oxts_values(file)
        geodetic = values[:, :3]
        sigma = np.repeat(np.maximum(values[:, [OXTS_ACCURACY]], 0.01), 3, axis=1)
    elif file.name.lower().endswith(NMEA_SUFFIXES):
        stamps, fixes = read_gga(file)
        times_ns = np.array(stamps, np.int64)
        geodetic = np.array([[f.latitude_deg, f.longitude_deg, f.height_m] for f in fixes])
        sigma = np.stack([f.sigma_m for f in fixes])
    else:
        table = read_table(file, columns)
        times_ns, sigma = table.times_ns, gnss_sigma(table, default)
        if not table.has(GEODETIC):
            return times_ns, {"xyz": table.stacked(LOCAL), "sigma": sigma}
        geodetic = table.stacked(GEODETIC)
    if default is not None:
        sigma = np.full_like(sigma, default)
    doubts, nowhere = geodetic_doubts(f"{path}: {name}", geodetic)
    if nowhere:
        raise impossible(doubts)
    origin = geodetic[int(np.argmin(null_fixes(geodetic)))]  # the first that is a fix
    if entry.get("origin") is not None:
        bounds = ((-90, 90), (-360, 360), (-MAX_HEIGHT_M, MAX_HEIGHT_M))
        given = finite_numbers(path, f"{name}.origin", entry["origin"], 3)
        origin = np.array([number(f"{path}: {name}.origin", v, *b) for v, b in zip(given, bounds, strict=True)])
    return times_ns, {"xyz": local_of(geodetic, origin), "sigma": sigma, "geodetic": geodetic}


def local_of(geodetic: Array, origin: Array) -> Array:
    """Returns east, north and up (N, 3) [m] of latitude, longitude [deg] and ellipsoidal height [m] (N, 3)."""
    import pymap3d

    return np.stack(pymap3d.geodetic2enu(*np.asarray(geodetic, float).T, *origin), axis=1)


def _number(path: Path, name: str, entry: dict[Any, Any], key: str, default: Any, least: float, most: float) -> Any:
    if entry.get(key) is None:
        return default
    return finite_numbers(path, f"{name}.{key}", [entry[key]], 1, least, most)[0]
