"""Tables of poses with a header that names their columns: comma, semicolon, tab or space between them, in any order."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.io.rows import Row, latest, numbers, read_text
from ispom.io.values import MAX_TIME_S
from ispom.types import FrameName, Trajectory

UNITS_NS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
POSE_COLUMNS, HEADER_LINES = 8, 200
"""Number of columns of a pose with a time, and number of first lines that are searched for a header."""
USUAL_S = 0.05
"""Interval of poses at 20 Hz: whole-number times without a unit have the unit in which their interval is nearest to
it."""
DATES_S = (1.0e9, 2.1e9)
"""Range of times since 1970, from 2001 to 2036: times in this range in a unit are dates in that unit."""
_UNIT_WORDS = {
    "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s",
    "ms": "ms", "msec": "ms", "millis": "ms", "milliseconds": "ms",
    "us": "us", "usec": "us", "micros": "us", "microseconds": "us",
    "ns": "ns", "nsec": "ns", "nsecs": "ns", "nanos": "ns", "nanosec": "ns", "nanosecs": "ns", "nanoseconds": "ns",
}  # fmt: skip
_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_ANGLES = {"deg": "deg", "degree": "deg", "degrees": "deg", "rad": "rad", "radian": "rad", "radians": "rad"}
_EULER, _GLOBE = ("roll", "pitch", "yaw"), ("latitude", "longitude", "height")
_OTHERS = {
    "roll": {"roll"}, "pitch": {"pitch"}, "yaw": {"yaw"},
    "latitude": {"latitude", "lat"}, "longitude": {"longitude", "lon", "lng", "long"},
    "height": {"altitude", "alt", "height", "elevation", "ele"},
}  # fmt: skip
"""Names of angles, and of geographic coordinates."""
_TIMES = ("stamp", "timestamp", "timestamps", "time", "times", "ts", "t")
"""Names of a column of times; the first of these has priority."""
_POSITION = frozenset({"p", "t", "pos", "position", "trans", "translation", "tvec", "location", "xyz"})
_ROTATION = frozenset({"q", "quat", "quaternion", "orientation", "rot", "rotation", "qvec", "attitude"})
_AXIS = re.compile(r"([a-z]*?)_?([xyzw])")


@dataclass(frozen=True)
class Columns:
    """The columns of a pose's values, counted from 0."""

    times: tuple[int, ...]
    """One column, or one of whole seconds and one of the nanoseconds after them."""
    xyz: tuple[int, ...]
    xyzw: tuple[int, ...]
    unit: str | None
    """Unit of the times; None where the header has none."""
    count: int
    line: int = 0
    """Line of the header, counted from 1."""
    spaced: bool = True
    """Whether the header's names are separated by spaces or tabs."""
    metres: float = 1.0
    """Unit of the positions [m]."""

    @property
    def order(self) -> tuple[int, ...]:
        """Columns of times, position, quaternion (x, y, z, w)."""
        return (*self.times, *self.xyz, *self.xyzw)


@dataclass(frozen=True)
class Roles:
    """The columns of each quantity that a header names, counted from 0; empty for a quantity without a name."""

    line: int
    times: tuple[int, ...]
    unit: str | None
    xyz: tuple[int, ...]
    metres: float
    xyzw: tuple[int, ...]
    angles: tuple[int, ...] = ()
    """Roll, pitch and yaw."""
    angle_unit: str | None = None
    """deg, rad, or None where the header has no unit of the angles."""
    geographic: tuple[int, ...] = ()
    """Latitude, longitude and, if there is one, the height."""


def header_columns(path: Path) -> Columns | None:
    """Reads the columns from the last line before a file's first values; None where there is no header.

    The header may begin with # or %. Raises InputError for a comma-separated header without the columns of a pose: the
    order of a quaternion cannot be inferred from its values.
    """
    columns, unknown = None, (0, 0)
    for line, words, spaced, is_data in _head_lines(path):
        if is_data:
            if columns is None and unknown[1] == len(words) and not spaced:
                raise InputError(
                    f"{path} line {unknown[0]} does not name the columns of poses: call them timestamp, x, y, z, qx, "
                    "qy, qz, qw (in any order)"
                )
            break
        columns = _columns(words, line, spaced) or columns
        if len(words) >= POSE_COLUMNS and not any(map(_is_number, words)):
            unknown = line, len(words)
    return columns


def header_roles(path: Path) -> Roles | None:
    """Reads the roles of the columns from the last line before a file's first values that names positions or geographic
    coordinates; None without such a line. Times and rotations may be missing."""
    found = None
    for line, words, _, is_data in _head_lines(path):
        if is_data:
            break
        roles = roles_of(words, line)
        found = roles if roles is not None and (roles.xyz or roles.geographic) else found
    return found


def _head_lines(path: Path) -> Iterator[tuple[int, list[str], bool, bool]]:
    """Yields number and words of the first lines, whether the words are separated by white space, and whether they are
    values."""
    for line, text in enumerate(read_text(path).splitlines()[:HEADER_LINES], 1):
        words = split_line(text.strip().lstrip("#%").strip())
        if words:
            is_data = not text.lstrip().startswith(("#", "%")) and _is_number(words[0])
            yield line, words, not set(",;") & set(text), is_data


def read_pose_table(path: Path, columns: Columns, frame: FrameName, every: bool) -> tuple[Trajectory, str]:
    """Reads world_from_FRAME from a file with these columns, and the unit of its times; `every` as in `latest`.

    Raises InputError that names the invalid line.
    """
    rows = _rows(path, columns)
    times, unit = times_in(path, rows, columns.times, columns.unit)
    order = columns.order[len(columns.times) :]
    values = np.array([numbers(path, line, [words[i] for i in order]) for line, words in rows]).reshape(-1, len(order))
    return latest(path, rows, times, values[:, :3] * columns.metres, values[:, 3:], frame, every), unit


def times_in(
    path: Path, rows: Sequence[Row], columns: tuple[int, ...], unit: str | None
) -> tuple[NDArray[np.int64], str]:
    """Returns the times (N,) [ns] and their unit, which is inferred from the values where it is None.

    `columns` is that of the times, or those of whole seconds and of the nanoseconds after them. Raises InputError that
    names the invalid line.
    """
    unit = unit or unit_of([words[columns[0]] for _, words in rows])
    return np.array([_time_ns(path, line, [words[i] for i in columns], unit) for line, words in rows], np.int64), unit


def split_line(text: str) -> list[str]:
    """Returns the words of a line, separated by semicolons, or else by commas, or else by white space."""
    for separator in (";", ","):
        if separator in text:
            words = [word.strip().strip("\"'").strip() for word in text.rstrip(f"{separator} \t").split(separator)]
            return [re.sub(r"(?<=[0-9]),(?=[0-9])", ".", word) for word in words] if separator == ";" else words
    return text.split()


def unit_of(words: list[str]) -> str:
    """Infers the unit of times: that in which they are dates, or else that in which their interval is nearest to
    USUAL_S."""
    values = [value for word in words if (value := _decimal(word)) is not None]
    if not values:
        return "s"
    for unit, unit_ns in UNITS_NS.items():
        if all(DATES_S[0] <= value * unit_ns / 10**9 <= DATES_S[1] for value in (values[0], values[-1])):
            return unit
    if any(value != value.to_integral_value() for value in values):
        return "s"
    intervals = sorted(b - a for a, b in pairwise(values) if b > a)
    if not intervals:
        return "ns" if values[0] > MAX_TIME_S else "s"
    usual_s = float(intervals[len(intervals) // 2])
    return min(UNITS_NS, key=lambda unit: abs(np.log(usual_s * UNITS_NS[unit] * 1e-9 / USUAL_S)))


NANOSECOND_DIGITS = 9
"""Number of digits of 999,999,999 nanoseconds."""
LEAST_GAIN = 0.5
"""Factor by which another reading of times must reduce the scatter of their intervals to be accepted."""


def unpadded_nanoseconds(words: Sequence[str]) -> NDArray[np.int64] | None:
    """Returns the times (N,) [ns] of words that are seconds and whole nanoseconds with a point or _ between them, but
    without the leading zeros (100.33333333 for 100.033333333); None where they are decimal seconds.

    With a point this reading is accepted if the intervals are more even with it, and no fraction has a leading zero.
    """
    if not words or ("_" not in words[0] and max(len(word.partition(".")[2]) for word in words) != NANOSECOND_DIGITS):
        return None  # the usual case
    matches = [re.fullmatch(r"([0-9]{1,10})([._])([0-9]{1,9})", word) for word in words]
    parts = [match for match in matches if match is not None]
    if len(parts) < max(3, len(words)) or len({match[2] for match in parts}) > 1:
        return None
    longest = max(len(match[3]) for match in parts)
    seconds = np.array([int(match[1]) for match in parts], np.int64) * 10**9
    times = seconds + np.array([int(match[3]) for match in parts], np.int64)
    if parts[0][2] == "_":
        return times if longest >= 8 else None
    padded = any(match[3][0] == "0" and match[3].strip("0") for match in parts)
    if longest < 9 or padded or all(len(match[3]) == 9 for match in parts):
        return None
    decimal = seconds + np.array([int(f"{match[3]:0<9}") for match in parts], np.int64)
    return times if _unevenness(times) < LEAST_GAIN * _unevenness(decimal) else None


def _unevenness(times: NDArray[np.int64]) -> float:
    """Returns the mean absolute deviation of the intervals from their median [ns]."""
    steps = np.diff(np.sort(times))
    return float(np.abs(steps - np.median(steps)).mean())


def _columns(words: list[str], line: int, spaced: bool) -> Columns | None:
    """Returns the columns of a header's names; None where one is missing or given twice."""
    roles = roles_of(words, line)
    if roles is None or not (roles.times and roles.xyz and roles.xyzw):
        return None
    return Columns(
        roles.times, roles.xyz, roles.xyzw, roles.unit, count=len(words), line=line, spaced=spaced, metres=roles.metres
    )


def roles_of(words: list[str], line: int = 0) -> Roles | None:
    """Returns the roles of the columns with these names; None where a role or a unit of lengths is given twice."""
    names = _Names()
    if not all(names.add(column, word) for column, word in enumerate(words)) or len(names.length_units) > 1:
        return None
    xyz, xyzw = names.position_and_quaternion()
    times, unit = _best_times(names.times) if names.times else ((), None)
    others, units = names.others, names.angle_units
    return Roles(
        line,
        times,
        unit,
        xyz,
        _METRES[names.length_units.pop()] if names.length_units else 1.0,
        xyzw,
        tuple(others[key] for key in _EULER) if others.keys() >= set(_EULER) else (),
        units.pop() if len(units) == 1 else None,
        tuple(others[key] for key in _GLOBE if key in others) if others.keys() >= {*_GLOBE[:2]} else (),
    )


@dataclass
class _Names:
    """The columns of a header by the roles of their names."""

    times: dict[tuple[str, str | None], int] = field(default_factory=dict)
    """By the kind of time, and its unit."""
    axes: dict[tuple[str, str], int] = field(default_factory=dict)
    """By "p" (position), "q" (quaternion) or "" (not named), and the axis."""
    others: dict[str, int] = field(default_factory=dict)
    """By the keys of _OTHERS."""
    length_units: set[str] = field(default_factory=set)
    angle_units: set[str | None] = field(default_factory=set)

    def add(self, column: int, word: str) -> bool:
        """Adds a column with this name; returns False where its role is already taken."""
        name, unit = _unit(word)
        parts = [part for part in re.split(r"[^a-z0-9]+", name) if part]
        if len(parts) > 1 and parts[-1] in (*_METRES, *_ANGLES):
            unit = parts.pop()
        other = next((key for key, words in _OTHERS.items() if parts and parts[-1] in words), None)
        axis = _axis(parts)
        if other is not None:
            if other in self.others:
                return False
            self.others[other] = column
            self.angle_units |= {_ANGLES.get(unit or "")} if other in _EULER else set()
        elif axis is not None:
            if axis in self.axes:
                return False
            self.axes[axis] = column
            self.length_units |= {unit} & set(_METRES) if axis[0] != "q" and unit is not None else set()
        elif parts and (time := _time_name(parts)) is not None:
            self.times.setdefault((time[0], _UNIT_WORDS.get(unit or "") or time[1]), column)
        return True

    def position_and_quaternion(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Returns the columns x, y, z and x, y, z, w; empty where one is missing.

        Axes without a kind are those of the position, or of the quaternion where the position has named columns.
        """
        axes = dict(self.axes)
        bare = {axis: column for (kind, axis), column in axes.items() if not kind}
        for kind, letters in (("p", "xyz"), ("q", "xyzw")):
            if not any((kind, axis) in axes for axis in "xyz"):
                axes |= {(kind, axis): bare[axis] for axis in letters if axis in bare}
                bare = {axis: column for axis, column in bare.items() if axis not in "xyz"}
        axes |= {("q", axis): column for axis, column in bare.items() if axis == "w"}
        xyz = tuple(axes[key] for axis in "xyz" if (key := ("p", axis)) in axes)
        xyzw = tuple(axes[key] for axis in "xyzw" if (key := ("q", axis)) in axes)
        return xyz if len(xyz) == 3 else (), xyzw if len(xyzw) == 4 else ()


def _unit(word: str) -> tuple[str, str | None]:
    """Returns a name in small letters without the unit in brackets at its end, and that unit; None without one."""
    match = re.fullmatch(r"(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]?", word.strip().lower().replace("µ", "u"))
    return (word.strip().lower(), None) if match is None else (match[1], match[2])


def _axis(parts: list[str]) -> tuple[str, str] | None:
    """Returns ("p" or "q", axis) of a name's parts: tx, p_RS_R_x, pose.position.x; qw, q_RS_w, orientation.w. Returns
    ("", axis) for only an axis, and None for another name."""
    match = _AXIS.fullmatch(parts[-1]) if parts else None
    if match is None:
        return None
    prefix, axis = match.groups()
    before = [prefix] if prefix else [part for part in parts[:-1] if part in _POSITION | _ROTATION]
    if not before:
        return None if parts[:-1] else ("", axis)
    if prefix == "" and before[0] != next((p for p in parts if p in _POSITION | _ROTATION | {"v", "b", "w", "a"}), ""):
        return None
    kind = "p" if before[0] in _POSITION else "q" if before[0] in _ROTATION else None
    return None if kind is None or (kind == "p" and axis == "w") else (kind, axis)


def _time_name(parts: list[str]) -> tuple[str, str | None] | None:
    """Returns the kind and the unit of a time's name (timestamp, time_ns, header.stamp.sec); None for another name."""
    unit = _UNIT_WORDS.get(parts[-1])
    name = next((part for part in reversed(parts) if part in _TIMES), None)
    if name is None and unit is not None and len(parts) == 1 and parts[0] != "s":
        name = "time"
    return None if name is None or (unit is None and parts[-1] != name) else (name, unit)


def _best_times(times: dict[tuple[str, str | None], int]) -> tuple[tuple[int, ...], str | None]:
    """Returns the column of times, or those of seconds and of the nanoseconds after them, and their unit."""
    name = min((name for name, _ in times), key=_TIMES.index)
    units = {unit: i for (each, unit), i in times.items() if each == name}
    if {"s", "ns"} <= units.keys():
        return (units["s"], units["ns"]), "s"
    unit, column = next(iter(units.items()))
    return (column,), unit


def _rows(path: Path, columns: Columns) -> list[Row]:
    rows: list[Row] = []
    for line, text in enumerate(read_text(path).splitlines(), 1):
        words = split_line(text.strip())
        if not words or line == columns.line or text.lstrip().startswith(("#", "%")):
            continue
        column_count = max(max(columns.order) + 1, len(rows[0][1]) if rows else 0)
        if len(words) < column_count or (rows and len(words) != column_count):
            raise InputError(f"{path} line {line} has {len(words)} columns, not {column_count}: correct that line")
        rows.append((line, words))
    return rows


def _time_ns(path: Path, line: int, words: list[str], unit: str) -> int:
    values = [_decimal(word) for word in words]
    scales = (UNITS_NS[unit], 1)
    total = sum((v * s for v, s in zip(values, scales, strict=False) if v is not None), Decimal(0))
    if None in values or abs(total) > MAX_TIME_S * 10**9 or (unit == "ns" and total != total.to_integral_value()):
        whole = "whole nanoseconds" if unit == "ns" else {"s": "seconds"}.get(unit, unit)
        raise InputError(f"{path} line {line}: '{words[0][:40]}' is not a time in {whole}: correct that line")
    return int(total.to_integral_value())


def _decimal(word: str) -> Decimal | None:
    try:
        value = Decimal(word)
    except InvalidOperation:
        return None
    return value if value.is_finite() and abs(value) < 10**25 else None


def _is_number(word: str) -> bool:
    return _decimal(word) is not None or word.lower() in ("nan", "inf", "-inf")
