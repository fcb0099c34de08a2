"""Points of a laser scanner, each with a time: CSV with a header, or PLY."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.io.files import require_file
from ispom.io.rows import read_text
from ispom.io.values import LARGEST, MAX_TIME_S
from ispom.types import TimedPoints

COORDINATES = ("x", "y", "z")
TIMES = ("time_s", "time", "timestamp", "t", "gps_time")
"""Names of a column or property of times [s], in addition to time_ns."""
MAX_BYTES = 4 << 30
"""Largest size of a file, which is read at once."""


def read_timed_points(path: Path) -> TimedPoints:
    """Reads a CSV file with columns x, y, z [m] and time_s (or time_ns), or a PLY file with such properties of its
    vertices; others are ignored. Raises InputError that names file and line, or what is missing."""
    require_file(path)
    columns = _ply(path) if path.suffix.lower() == ".ply" else _csv(path)
    times = _times_ns(path, columns)
    xyz = np.stack([columns[name] for name in COORDINATES], axis=1).astype(float)
    if not len(times):
        raise InputError(f"{path} holds no point: give the laser's points")
    wrong = np.flatnonzero(~(np.abs(xyz) <= LARGEST).all(axis=1))
    if len(wrong):
        raise InputError(f"{path}: point {wrong[0] + 1} has no finite coordinates: remove it")
    return TimedPoints(times, xyz)


def holds_points(path: Path) -> bool:
    """Checks for a PLY file, or a CSV file whose first line names x, y and z."""
    if path.suffix.lower() == ".ply":
        return True
    require_file(path)
    header = next(csv.reader(read_text(path, MAX_BYTES).splitlines()[:1]), [])
    return set(COORDINATES) <= {name.strip().lower() for name in header}


def timed_points_csv(points: TimedPoints) -> str:
    """Returns the file's content."""
    rows = zip(points.times_ns.tolist(), points.xyz_in_laser.tolist(), strict=True)
    return "time_ns,x,y,z\n" + "".join(f"{t},{x:.4f},{y:.4f},{z:.4f}\n" for t, (x, y, z) in rows)


def _csv(path: Path) -> dict[str, NDArray]:
    lines = read_text(path, MAX_BYTES).splitlines()
    header = [name.strip().lower() for name in next(csv.reader(lines[:1]), [])]
    _require(path, header)
    columns = {name: header.index(name) for name in (*COORDINATES, _time_name(header))}
    if not any(line.strip() for line in lines[1:]):
        raise InputError(f"{path} holds no point: give the laser's points")
    try:  # an integer of nanoseconds has more digits than a float
        kinds = [(name, np.int64 if name == "time_ns" else float) for name in columns]
        table = np.loadtxt(
            lines[1:], dtype=np.dtype(kinds), delimiter=",", usecols=list(columns.values()), ndmin=1, comments="#"
        )
    except (ValueError, IndexError):
        raise InputError(f"{path} line {_first_wrong(lines, columns)}: its values are no numbers: correct it") from None
    return {name: table[name] for name in columns}


def _first_wrong(lines: list[str], columns: dict[str, int]) -> int:
    for number, line in enumerate(lines[1:], 2):
        words = line.split(",")
        try:
            _ = [int(words[i]) if name == "time_ns" else float(words[i]) for name, i in columns.items()]
        except (ValueError, IndexError):
            if line.strip() and not line.startswith("#"):
                return number
    return len(lines)


def _ply(path: Path) -> dict[str, NDArray]:
    import trimesh

    try:
        cloud = trimesh.load(path, file_type="ply", process=False)
        content = cloud.metadata["_ply_raw"]["vertex"]
        count, data = content["length"], content["data"]
        names = data.dtype.names if isinstance(data, np.ndarray) else data.keys()
        columns = {name.lower(): np.asarray(data[name]).reshape(count) for name in names}
    except Exception:  # its parser raises a dozen kinds on damaged bytes
        raise InputError(f"{path} is damaged, or no PLY file of points: give another file") from None
    _require(path, list(columns))
    return columns


def _time_name(names: list[str]) -> str:
    return next((name for name in ("time_ns", *TIMES) if name in names), "")


def _require(path: Path, names: list[str]) -> None:
    missing = [name for name in COORDINATES if name not in names] or ([] if _time_name(names) else ["time_s"])
    if missing:
        raise InputError(f"{path} has no {missing[0]} of its points: give x, y, z [m] and time_s (or time_ns)")


def _times_ns(path: Path, columns: dict[str, NDArray]) -> NDArray[np.int64]:
    name = _time_name(list(columns))
    values = columns[name]
    seconds = values.astype(float) * (1e-9 if name == "time_ns" else 1.0)
    if len(seconds) and not (np.abs(seconds) <= MAX_TIME_S).all():
        number = int(np.flatnonzero(~(np.abs(seconds) <= MAX_TIME_S))[0]) + 1
        raise InputError(f"{path}: the time of point {number} is no time in seconds: correct it")
    if name == "time_ns" and values.dtype.kind in "iu":
        return values.astype(np.int64)
    whole = np.floor(seconds)
    return whole.astype(np.int64) * 1_000_000_000 + np.rint((seconds - whole) * 1e9).astype(np.int64)
