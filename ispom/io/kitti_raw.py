"""The text files of a KITTI raw drive: `calib_cam_to_cam.txt` and `timestamps.txt`."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.rows import numbers, read_text
from ispom.types import Camera

_SHAPES = {"S": (2,), "K": (3, 3), "D": (5,), "S_rect": (2,), "R_rect": (3, 3), "P_rect": (3, 4)}
_STAMP = re.compile(r"(\d{4}-\d\d-\d\d \d\d:\d\d:\d\d)(?:\.(\d{1,9}))?", re.ASCII)


def read_calibrations(path: Path, cameras: tuple[str, ...]) -> list[dict[str, Array]]:
    """Of each camera ("00", "01" ...): S (2,) and S_rect (2,) sizes [px], K (3, 3), D (5,), R_rect (3, 3) and
    P_rect (3, 4). InputError names the line that is missing or wrong."""
    rows: dict[str, tuple[int, list[str]]] = {}
    for line, text in enumerate(read_text(path).splitlines(), 1):
        name, _, values = text.partition(":")
        rows[name.strip()] = (line, values.split())
    return [
        {name: _values(path, rows, f"{name}_{camera}", shape) for name, shape in _SHAPES.items()} for camera in cameras
    ]


def raw_camera(calibration: dict[str, Array]) -> Camera:
    """The camera of an unrectified image."""
    fx, fy, cx, cy = calibration["K"][[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    return Camera(*image_size(calibration["S"]), fx, fy, cx, cy, tuple(calibration["D"].tolist()))


def image_size(size: Array) -> tuple[int, int]:
    """Width and height of S or S_rect."""
    return int(size[0]), int(size[1])


def read_timestamps(path: Path, ordered: bool = True) -> NDArray[np.int64]:
    """(N,) [ns since 1970], increasing where `ordered`, of lines such as `2011-09-26 13:02:25.964389445`."""
    times_ns: list[int] = []
    for line, text in enumerate(read_text(path).splitlines(), 1):
        if not text.strip():
            continue
        times_ns.append(_time_ns(path, line, text.strip()))
        if ordered and len(times_ns) > 1 and times_ns[-1] <= times_ns[-2]:
            raise InputError(f"{path} line {line}: time {text.strip()} is not after the one before: put them in order")
    return np.array(times_ns, np.int64)


def _values(path: Path, rows: dict[str, tuple[int, list[str]]], name: str, shape: tuple[int, ...]) -> Array:
    line, words = rows.get(name, (0, []))
    if not line:
        raise InputError(f"{path} has no line '{name}: ...': give the calibration of the drive's day")
    if len(words) != np.prod(shape):
        raise InputError(
            f"{path} line {line}: {name} needs {np.prod(shape)} numbers, not {len(words)}: correct that line"
        )
    found = numbers(path, line, words).reshape(shape)
    if name[0] in "KP" and min(found[0, 0], found[1, 1]) <= 0:
        raise InputError(f"{path} line {line}: the focal length is not positive: correct that line")
    if name[0] == "S" and not ((found >= 1) & (found <= 65_536)).all():
        raise InputError(f"{path} line {line}: {name} is no size in pixels: correct that line")
    return found


def _time_ns(path: Path, line: int, text: str) -> int:
    match = _STAMP.fullmatch(text)
    try:
        moment = datetime.fromisoformat(match[1]).replace(tzinfo=UTC) if match else None
    except ValueError:
        moment = None
    if match is None or moment is None or not 1970 <= moment.year < 2115:
        raise InputError(f"{path} line {line}: '{text[:40]}' is not a date and a time: correct that line")
    return int(moment.timestamp()) * 10**9 + int((match[2] or "0").ljust(9, "0"))
