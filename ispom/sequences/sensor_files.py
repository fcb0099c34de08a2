"""Files of what an IMU, a GNSS receiver or wheels measured: tables, NMEA, and KITTI's oxts."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.files import is_folder
from ispom.io.kitti import read_oxts_values
from ispom.io.nmea import read_gga
from ispom.io.sensor_tables import GEODETIC, IMU, LOCAL, gnss_sigma, read_table
from ispom.plausibility.gnss import geodetic_doubts, null_fixes
from ispom.sequences.readings import Readings, impossible

NMEA_SUFFIXES = (".nmea", ".nma")
OXTS_GYROSCOPE, OXTS_ACCELEROMETER, OXTS_ACCURACY = slice(17, 20), slice(11, 14), 23
"""Columns of a line of KITTI's oxts: rates and accelerations about the unit's x, y, z, and the position's accuracy."""
LEAST_ACCURACY_M = 0.01
"""Standard deviation of a fix for which oxts states less."""

Columns = Mapping[str, str] | None
"""The usual names of columns to those of the file."""


def imu_readings(file: Path, columns: Columns = None) -> Readings:
    """Reads a table, or a folder of KITTI's oxts. Raises InputError that names what is wrong."""
    if is_folder(file):
        times_ns, rows = read_oxts_values(file)
        return Readings("imu", times_ns, {"rates": rows[:, OXTS_GYROSCOPE], "forces": rows[:, OXTS_ACCELEROMETER]})
    table = read_table(file, columns)
    rows = table.stacked(IMU)
    return Readings("imu", table.times_ns, {"rates": rows[:, :3], "forces": rows[:, 3:]})


def wheel_readings(file: Path, columns: Columns = None) -> Readings:
    """Reads a table. Raises InputError that names what is wrong."""
    table = read_table(file, columns)
    values = {"distances": table.stacked(("distance",))[1:, 0]}
    values |= {"turns": table.columns["turn"][1:]} if "turn" in table.columns else {}
    return Readings("wheel", table.times_ns, values)


def gnss_readings(
    where: str, file: Path, columns: Columns = None, sigma_m: float | None = None, origin: Array | None = None
) -> Readings:
    """Reads a table, NMEA, or a folder of KITTI's oxts, of which `sigma_m` takes the place of standard deviations.

    `origin` is latitude, longitude [deg] and height [m] of the local frame; else it is the first fix. Raises
    InputError that names what is wrong; `where` begins it where that is a position.
    """
    if is_folder(file):
        times_ns, values = read_oxts_values(file)
        geodetic = values[:, :3]
        sigma = np.repeat(np.maximum(values[:, [OXTS_ACCURACY]], LEAST_ACCURACY_M), 3, axis=1)
    elif file.name.lower().endswith(NMEA_SUFFIXES):
        stamps, fixes = read_gga(file)
        times_ns = np.array(stamps, np.int64)
        geodetic = np.array([[f.latitude_deg, f.longitude_deg, f.height_m] for f in fixes])
        sigma = np.stack([f.sigma_m for f in fixes])
    else:
        table = read_table(file, columns)
        times_ns, sigma = table.times_ns, gnss_sigma(table, sigma_m)
        if not table.has(GEODETIC):
            return Readings("gnss", times_ns, {"xyz": table.stacked(LOCAL), "sigma": sigma})
        geodetic = table.stacked(GEODETIC)
    if sigma_m is not None:
        sigma = np.full_like(sigma, sigma_m)
    return Readings("gnss", times_ns, geodetic_values(where, geodetic, sigma, origin))


def geodetic_values(where: str, geodetic: Array, sigma: Array, origin: Array | None = None) -> dict[str, Array]:
    """Returns the values of Readings of fixes: latitude, longitude [deg] and height [m] (N, 3), and their standard
    deviations (N, 3) [m]. Raises InputError, which begins with `where`, for positions that are nowhere."""
    doubts, nowhere = geodetic_doubts(where, geodetic)
    if nowhere:
        raise impossible(doubts)
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
