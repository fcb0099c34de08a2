"""Text files with one row of numbers per line; errors name their position."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.files import MAX_BYTES, read_bytes
from ispom.io.values import LARGEST, number, time_ns
from ispom.types import FrameName, Trajectory

Row = tuple[int, list[str]]
"""Line number, counted from 1, and the words of the line."""


def read_text(path: Path, max_bytes: int = MAX_BYTES) -> str:
    """Reads a text file in UTF-8, with or without byte-order mark. Raises InputError where it is missing, too long
    or not that."""
    content = read_bytes(path, max_bytes)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{path} line {line}: it is not a text file in UTF-8: save it as such, or give the right file"
        ) from None


def read_rows(path: Path, columns: int) -> list[Row]:
    """Returns all lines with values, without comments (#). Raises InputError where one has not `columns` words."""
    rows: list[Row] = []
    for line, text in enumerate(read_text(path).splitlines(), 1):
        words = text.split()
        if not words or words[0].startswith("#"):
            continue
        if len(words) != columns:
            raise InputError(f"{path} line {line} has {len(words)} columns, not {columns}: correct that line")
        rows.append((line, words))
    return rows


def numbers(path: Path, line: int, words: list[str], least: float = -LARGEST, most: float = LARGEST) -> Array:
    """Returns the words as finite numbers (N,) within bounds. Raises InputError that names the first invalid word."""
    try:
        values = np.array([float(word) for word in words])
        if ((values >= least) & (values <= most)).all():
            return values
    except ValueError:
        pass
    return np.array([number(f"{path} line {line}", word, least, most) for word in words])


def matrix(path: Path, shape: tuple[int, int]) -> Array:
    """Reads a matrix, which may have values that are not finite. Raises InputError that names the invalid line."""
    rows = read_rows(path, shape[1])
    if len(rows) != shape[0]:
        raise InputError(f"{path} has {len(rows)} rows, not {shape[0]}: restore the file")
    with suppress(ValueError):
        values = np.array([[float(word) for word in words] for _, words in rows])
        if (abs(values) <= LARGEST).all():
            return values
    missing = {"nan", "inf", "-inf", "-nan", "-1.#ind", "1.#qnan", "-1.#inf", "1.#inf"}
    if any(word.lower() in missing for _, words in rows for word in words):
        return np.full(shape, np.nan)
    return np.stack([numbers(path, line, words) for line, words in rows])


def times_ns(path: Path, rows: list[Row]) -> NDArray[np.int64]:
    """Returns the first words, decimal seconds, as integers (N,) [ns], exactly. Raises InputError where time goes
    backwards."""
    times = np.array([time_ns(f"{path} line {line}", words[0]) for line, words in rows], np.int64)
    _refuse(path, rows, np.diff(times) < 0)
    return times


def increasing_times_ns(path: Path, rows: list[Row]) -> NDArray[np.int64]:
    """Returns strictly increasing times (N,) [ns]. Raises InputError also where a time is repeated."""
    times = times_ns(path, rows)
    _refuse(path, rows, np.diff(times) == 0)
    return times


def latest(
    path: Path, rows: list[Row], times: NDArray[np.int64], positions: Array, xyzw: Array, frame: FrameName, every: bool
) -> Trajectory:
    """Returns the trajectory of times (N,), positions (N, 3) and quaternions (N, 4), with the last pose of each time.

    With `every` it has all poses, and times may repeat. Raises InputError where times decrease, and for a quaternion
    that is not of length 1 (to 1 %).
    """
    _refuse(path, rows, np.diff(times) < 0)
    lengths = np.linalg.norm(xyzw, axis=1)
    wrong = np.flatnonzero(abs(lengths - 1) > 0.01)
    if len(wrong):
        line = rows[wrong[0]][0]
        raise InputError(f"{path} line {line}: the quaternion's length is {lengths[wrong[0]]:.3g}, not 1: correct it")
    if not len(times):
        return Trajectory.empty(frame)
    last = np.append(every | (np.diff(times) > 0), True)
    return Trajectory(times[last], Rotation.from_quat(xyzw[last]).as_matrix(), positions[last], frame)


def _refuse(path: Path, rows: list[Row], wrong: NDArray[np.bool_]) -> None:
    if wrong.any():
        line, words = rows[np.flatnonzero(wrong)[0] + 1]
        raise InputError(f"{path} line {line}: time {words[0]} is not after the one before: put the lines in order")
