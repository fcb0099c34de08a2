"""Measurements of sensors other than cameras in tables: text files whose first line names the columns.

Columns are separated by commas, or by white space where the first line has no comma. Names: `time_ns` or `time_s`;
of an IMU `gx gy gz` [rad/s] and `ax ay az` [m/s^2]; of GNSS `x y z` [m] east, north and up, or `lat lon height`
(degrees, metres above the ellipsoid), perhaps `sigma` or `sigma_x sigma_y sigma_z` [m]; of a wheel `distance` [m] since
the row before, perhaps `turn` [rad]. A file with other names is read with a mapping of the usual to its own.
`imu0/data.csv` of EuRoC is read as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.rows import numbers, read_text
from ispom.io.values import LARGEST, MAX_SIGMA, MAX_TIME_S, MIN_SIGMA, number, time_ns

TIMES = {"time_ns": 1, "time_s": 10**9}
IMU = ("gx", "gy", "gz", "ax", "ay", "az")
LOCAL, GEODETIC = ("x", "y", "z"), ("lat", "lon", "height")
SIGMAS = ("sigma_x", "sigma_y", "sigma_z")
EUROC = {
    "time_ns": "#timestamp [ns]",
    **{f"g{a}": f"w_RS_S_{a} [rad s^-1]" for a in "xyz"},
    **{f"a{a}": f"a_RS_S_{a} [m s^-2]" for a in "xyz"},
}
"""Columns of EuRoC's `imu0/data.csv` by the usual names."""


@dataclass(frozen=True, eq=False)
class Table:
    """Numbers by the names of their columns."""

    path: Path
    times_ns: NDArray[np.int64]
    """(N,) strictly increasing."""
    columns: Mapping[str, Array]

    def stacked(self, names: tuple[str, ...]) -> Array:
        """Returns columns (N, K). Raises InputError for one that the file lacks."""
        if missing := [name for name in names if name not in self.columns]:
            known = ", ".join(self.columns) or "none but the time"
            raise InputError(f"{self.path} has no column {missing[0]} (it has {known}): name it in `columns`")
        return np.stack([self.columns[name] for name in names], axis=1)

    def has(self, names: tuple[str, ...]) -> bool:
        return all(name in self.columns for name in names)


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


def gnss_sigma(table: Table, default_m: float | None) -> Array:
    """Returns standard deviations (N, 3) [m] of a GNSS table.

    Raises InputError where neither the table nor the default has them, or one is not positive.
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
        number(f"{table.path}: a standard deviation", end, MIN_SIGMA, MAX_SIGMA)
    return sigma
