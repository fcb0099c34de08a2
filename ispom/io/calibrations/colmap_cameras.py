"""COLMAP's cameras.txt: CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]; it has no poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.io.calibrations.placed import Placed, camera_from
from ispom.io.colmap import PIXEL, camera_line
from ispom.io.rows import read_text
from ispom.types import Camera

_COUNTS = {"SIMPLE_PINHOLE": 3, "PINHOLE": 4, "SIMPLE_RADIAL": 4, "RADIAL": 5, "OPENCV": 8, "FULL_OPENCV": 12}
_COUNTS |= {"OPENCV_FISHEYE": 8, "SIMPLE_RADIAL_FISHEYE": 4, "RADIAL_FISHEYE": 5}
_ONE_FOCAL = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")


def colmap_cameras_text(cameras: list[Placed]) -> str:
    """Numbered from 1 in the order given."""
    lines = [camera_line(each.camera, n) for n, each in enumerate(cameras, 1)]
    return "\n".join(["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]", *lines]) + "\n"


def read_colmap_cameras(path: Path) -> list[Camera]:
    """In the order of the file; InputError names the line that is wrong."""
    out = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if len(words) < 4 or words[1] not in _COUNTS:
            raise InputError(f"{path} line {number}: give a camera of {', '.join(_COUNTS)}")
        try:
            values = [float(word) for word in words[2:]]
        except ValueError:
            raise InputError(f"{path} line {number} holds something else than numbers: correct that line") from None
        if len(values) != 2 + _COUNTS[words[1]] or not np.isfinite(values).all():
            raise InputError(f"{path} line {number}: {words[1]} has {_COUNTS[words[1]]} parameters: correct that line")
        out.append(_camera(path, number, words[1], values))
    if not out:
        raise InputError(f"{path} holds no camera: give COLMAP's cameras.txt")
    return out


def _camera(path: Path, number: int, model: str, values: list[float]) -> Camera:
    size, rest = values[:2], values[2:]
    focals = [rest[0], rest[0]] if model in _ONE_FOCAL else rest[:2]
    rest = rest[1:] if model in _ONE_FOCAL else rest[2:]
    centre, distortion = [v - PIXEL for v in rest[:2]], rest[2:]
    if model in ("SIMPLE_RADIAL", "RADIAL"):
        distortion = [*distortion, 0.0][:2]
        distortion = [*distortion, 0.0, 0.0]
    if model in ("SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"):
        distortion = [*distortion, 0.0, 0.0, 0.0][:4]
    lens = "fisheye" if "FISHEYE" in model else "opencv"
    return camera_from(path, f"line {number}", np.array(size), [*focals, *centre], distortion, lens)
