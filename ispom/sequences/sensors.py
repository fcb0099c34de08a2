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
from ispom.io.rig import NAME, sensor_of
from ispom.io.sensor_tables import GEODETIC, IMU, LOCAL, gnss_sigma, read_table
from ispom.types import GnssFix, ImuSamples, Measurement, Sensor, Sequence, WheelIncrement

KINDS = ("imu", "gnss", "wheel")
OWN = ("file", "columns", "clock_offset_s", "sigma_m", "origin")
"""Entries that a rig.yaml does not have."""
NMEA_SUFFIXES = (".nmea", ".nma")
BEFORE_NS = 100_000_000
"""What is measured longer before the first frame is skipped."""
OXTS_GYROSCOPE, OXTS_ACCELEROMETER, OXTS_ACCURACY = slice(17, 20), slice(11, 14), 23
"""Columns of a line of KITTI's oxts: rates and accelerations about the unit's x, y, z, and the position's accuracy."""


def with_sensors(sequence: Sequence, path: Path) -> Sequence:
    """Returns the sequence with the measurements of the sensors that a YAML file describes.

    Raises InputError that names the file, entry or line that is wrong, and where a sensor measured before or after the
    frames only. A gap of a sensor as long as the sequence is one of its notes.
    """
    if sequence.grow is not None:
        raise InputError(f"--sensors {path}: a live camera takes in no files of other sensors: leave it out")
    sensors, measurements, notes = dict[str, Sensor](), list[Measurement](), list[str]()
    frames_ns = sequence.times_ns
    for name, given in read_mapping(path).items():
        if not isinstance(given, dict) or given.get("sensor", name) not in KINDS or not NAME.fullmatch(str(name)):
            known = ", ".join(KINDS)
            raise InputError(f"{path}: {str(name)[:40]} is no sensor of the kinds {known}: give `sensor` and `file`")
        entry = {"sensor": name, **given}
        sensors[name] = sensor_of(path, name, {k: v for k, v in entry.items() if k not in OWN})
        found = list(_measured(path, name, entry, frames_ns))
        inside = [m for m in found if frames_ns[0] - BEFORE_NS <= m.time_ns <= frames_ns[-1]]
        if not inside:
            first, last = frames_ns[[0, -1]] * 1e-9
            when = "nothing" if not found else f"{found[0].time_ns * 1e-9:.3f} to {found[-1].time_ns * 1e-9:.3f} s"
            about = f"{path}: {name} measured nothing within the frames' {first:.3f} to {last:.3f} s (it has {when})"
            if not found or found[-1].time_ns < frames_ns[0] or found[0].time_ns > frames_ns[-1]:
                raise InputError(f"{about}: correct its file or its clock_offset_s")
            notes.append(f"{about}.")
        measurements += inside
    changed = replace(sequence, rig=sequence.rig.changed(**sensors), notes=(*sequence.notes, *notes))
    return changed.with_measurements(measurements)


def _measured(path: Path, name: str, entry: dict[Any, Any], frames_ns: NDArray[np.int64]) -> Iterator[Measurement]:
    """Yields what one sensor measured, in the order of time."""
    given = entry.get("file")
    if not isinstance(given, str):
        raise InputError(f"{path}: {name}.file is missing: name the file that holds its measurements")
    columns = entry.get("columns")
    if columns is not None and not (isinstance(columns, dict) and all(isinstance(v, str) for v in columns.values())):
        raise InputError(f"{path}: {name}.columns must map usual names to those of the file: correct it")
    offset_ns = round(1e9 * _number(path, name, entry, "clock_offset_s", 0.0))
    file, kind = path.parent / given, entry["sensor"]
    if kind == "gnss":
        times_ns, positions, sigma = _fixes(path, name, entry, file, columns)
        for time_ns, xyz, sigmas in zip(times_ns + offset_ns, positions, sigma, strict=True):
            yield GnssFix(int(time_ns), xyz, np.diag(sigmas**2), name)
        return
    if kind == "wheel":
        table = read_table(file, columns)
        turns = table.columns.get("turn")
        rows = zip(table.times_ns[1:], table.times_ns[:-1], table.stacked(("distance",))[1:, 0], strict=True)
        for i, (time_ns, since_ns, way) in enumerate(rows, 1):
            turn = None if turns is None else float(turns[i])
            yield WheelIncrement(int(time_ns) + offset_ns, int(since_ns) + offset_ns, float(way), turn, name)
        return
    if is_folder(file):
        times_ns, values = read_oxts_values(file)
        rates, forces = values[:, OXTS_GYROSCOPE], values[:, OXTS_ACCELEROMETER]
    else:
        table = read_table(file, columns)
        times_ns, samples = table.times_ns, table.stacked(IMU)
        rates, forces = samples[:, :3], samples[:, 3:]
    yield from imu_measurements(times_ns + offset_ns, rates, forces, frames_ns, name)


def imu_measurements(
    times_ns: NDArray[np.int64], rates: Array, forces: Array, frames_ns: NDArray[np.int64], name: str
) -> Iterator[ImuSamples]:
    """Yields the samples from one frame to the next; those before BEFORE_NS and after the last frame are skipped."""
    keep = (times_ns >= frames_ns[0] - BEFORE_NS) & (times_ns <= frames_ns[-1])
    if not keep.any() and len(times_ns):
        keep[[0, -1]] = True  # for the message about the clock
    times_ns, rates, forces = times_ns[keep], rates[keep], forces[keep]
    part = np.searchsorted(frames_ns, times_ns)
    for index in np.split(np.arange(len(times_ns)), np.flatnonzero(np.diff(part)) + 1):
        if len(index):
            yield ImuSamples(int(times_ns[index[-1]]), times_ns[index], rates[index], forces[index], name)


def _fixes(
    path: Path, name: str, entry: dict[Any, Any], file: Path, columns: dict[str, str] | None
) -> tuple[NDArray[np.int64], Array, Array]:
    """Returns times (N,), local positions (N, 3) and their standard deviations (N, 3)."""
    default = _number(path, name, entry, "sigma_m", None)
    if default is not None and default <= 0:
        raise InputError(f"{path}: {name}.sigma_m is {default:g}, give a positive value")
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
            return times_ns, table.stacked(LOCAL), sigma
        geodetic = table.stacked(GEODETIC)
    if default is not None:
        sigma = np.full_like(sigma, default)
    origin = geodetic[0]
    if entry.get("origin") is not None:
        origin = np.array(finite_numbers(path, f"{name}.origin", entry["origin"], 3))
    return times_ns, local_of(geodetic, origin), sigma


def local_of(geodetic: Array, origin: Array) -> Array:
    """Returns east, north and up (N, 3) [m] of latitude, longitude [deg] and ellipsoidal height [m] (N, 3)."""
    import pymap3d

    return np.stack(pymap3d.geodetic2enu(*np.asarray(geodetic, float).T, *origin), axis=1)


def _number(path: Path, name: str, entry: dict[Any, Any], key: str, default: Any) -> Any:
    if entry.get(key) is None:
        return default
    return finite_numbers(path, f"{name}.{key}", [entry[key]], 1)[0]
