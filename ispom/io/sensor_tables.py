"""Measurements of sensors other than cameras in tables: text files whose first line names the columns.

Columns are separated by commas, or by white space where the first line has no comma. Names: `time_ns` or `time_s`;
of an IMU `gx gy gz` [rad/s] and `ax ay az` [m/s^2]; of GNSS `x y z` [m] east, north and up, or `lat lon height`
(degrees, metres above the ellipsoid), perhaps `sigma` or `sigma_x sigma_y sigma_z` [m]; of a wheel `distance` [m] since
the row before, perhaps `turn` [rad]. A file with other names is read with a mapping of the usual to its own.
`imu0/data.csv` of EuRoC is read as it is; NMEA and KITTI's oxts are read as tables with these names.
"""

from __future__ import annotations

from collections.abc import Mapping
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.files import is_folder
from ispom.io.kitti import read_oxts_values
from ispom.io.nmea import read_gga
from ispom.io.rows import numbers, read_text
from ispom.io.values import LARGEST, MAX_TIME_S, time_ns
from ispom.sensors.kind import Table

TIMES = {"time_ns": 1, "time_s": 10**9}
NMEA_SUFFIXES = (".nmea", ".nma")
OXTS = {"lat": 0, "lon": 1, "height": 2, "ax": 11, "ay": 12, "az": 13, "gx": 17, "gy": 18, "gz": 19}
"""Columns of a line of KITTI's oxts: position, and accelerations and rates about the unit's x, y, z."""
OXTS_ACCURACY, LEAST_ACCURACY_M = 23, 0.01
"""The column of the position's accuracy, and the standard deviation of a fix that states less."""
EUROC = {
    "time_ns": "#timestamp [ns]",
    **{f"g{a}": f"w_RS_S_{a} [rad s^-1]" for a in "xyz"},
    **{f"a{a}": f"a_RS_S_{a} [m s^-2]" for a in "xyz"},
}
"""Columns of EuRoC's `imu0/data.csv` by the usual names."""


def read_measurements(path: Path, columns: Mapping[str, str] | None = None) -> Table:
    """Reads a table, NMEA, or a folder of KITTI's oxts. Raises InputError that names what is wrong."""
    if is_folder(path):
        times_ns, rows = read_oxts_values(path)
        named = {name: rows[:, i] for name, i in OXTS.items()}
        return Table(path, times_ns, {**named, "sigma": np.maximum(rows[:, OXTS_ACCURACY], LEAST_ACCURACY_M)})
    if not path.name.lower().endswith(NMEA_SUFFIXES):
        return read_table(path, columns)
    stamps, fixes = read_gga(path)
    values = np.array([[f.latitude_deg, f.longitude_deg, f.height_m, *f.sigma_m] for f in fixes])
    names = ("lat", "lon", "height", "sigma_x", "sigma_y", "sigma_z")
    return Table(path, np.array(stamps, np.int64), dict(zip(names, values.T, strict=True)))


def read_table(path: Path, columns: Mapping[str, str] | None = None) -> Table:
    """Reads a table; `columns` maps the usual names to those of the file.

    Raises InputError that names the line of an invalid number, and for times that are missing or do not increase.
    """
    lines = [(i, text.strip()) for i, text in enumerate(read_text(path).splitlines(), 1) if text.strip()]
    if not lines:
        raise InputError(f"{path} is empty: its first line must name the columns")
    comma = "," if "," in lines[0][1] else None
    header = [word.strip() for word in lines[0][1].split(comma)]
    if columns is None and EUROC["time_ns"] in header:
        columns = EUROC
    own = dict(columns or {})
    if absent := [name for name in own.values() if name not in header]:
        raise InputError(f"{path} has no column {absent[0]!r}, which `columns` names: its columns are {header}")
    usual = {theirs: ours for ours, theirs in own.items()}
    names = [usual.get(word, word) for word in header]
    if len(set(names)) < len(names):
        raise InputError(f"{path} names a column twice in its first line: correct it")
    clock = next((name for name in TIMES if name in names), None)
    if clock is None:
        raise InputError(f"{path} has no column time_ns or time_s in its first line ({', '.join(header)[:80]}): add it")
    others = [name for name in names if name != clock]
    found = _at_once([text for _, text in lines[1:]], comma, len(names), names.index(clock), TIMES[clock])
    if found is not None:
        return Table(path, found[0], {name: found[1][:, i] for i, name in enumerate(others)})
    times, rows = list[int](), list[Array]()
    for line, text in lines[1:]:
        words = [word.strip() for word in text.split(comma)]
        if len(words) != len(names):
            raise InputError(f"{path} line {line} has {len(words)} columns, not {len(names)}: correct that line")
        times.append(time_ns(f"{path} line {line}", words[names.index(clock)], TIMES[clock]))
        if len(times) > 1 and times[-1] <= times[-2]:
            raise InputError(f"{path} line {line}: its time is not after the one before: put the lines in order")
        rows.append(numbers(path, line, [word for name, word in zip(names, words, strict=True) if name != clock]))
    if not rows:
        raise InputError(f"{path} has no rows below its first line: restore the file")
    values = np.stack(rows)
    return Table(path, np.array(times, np.int64), {name: values[:, i] for i, name in enumerate(others)})


def _at_once(
    rows: list[str], comma: str | None, columns: int, clock: int, unit_ns: int
) -> tuple[NDArray[np.int64], Array] | None:
    """Returns times (N,) [ns] and the other values (N, K) of rows without a fault; None where there is one."""
    if not rows:
        return None
    try:
        values = np.loadtxt(rows, delimiter=comma, comments=None, ndmin=2)
        words = [row.split(comma)[clock].strip() for row in rows]
        times = np.array([int((Decimal(word) * unit_ns).to_integral_value()) for word in words], np.int64)
    except (ValueError, ArithmeticError):
        return None
    others = np.delete(values, clock, axis=1)
    late = max(abs(int(times[0])), abs(int(times[-1]))) > MAX_TIME_S * 10**9
    if late or values.shape[1] != columns or not (np.diff(times) > 0).all() or not (abs(others) <= LARGEST).all():
        return None
    return times, others
