"""DSO's camera.txt: a lens with its numbers, the size, how DSO rectifies (crop, full, none), the size after that.

Pixel (0, 0) is the centre of the top-left pixel; where cx and cy are below 1, all four are shares of the image's sides,
and half a pixel is subtracted, as DSO does. RadTan: k1 k2 p1 p2. EquiDistant and KannalaBrandt: k1 to k4. Five numbers
without a name are the FOV lens, which is not supported unless its last number is 0. The camera is that of the images
before DSO rectifies them. Source: DSO, README and src/util/Undistort.cpp.
"""

from __future__ import annotations

import re

from ispom.errors import InputError
from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CORNER_ORIGIN_PX, CalibrationFile, Dialect, lens_camera, not_supported
from ispom.io.rows import numbers

_LENSES = {"radtan": "opencv", "pinhole": "opencv", "equidistant": "fisheye", "kannalabrandt": "fisheye", "fov": "fov"}
_RECTIFIES = re.compile(r"crop|full|none|(\S+ ){4}\S+")
_MAX_LINES = 8
"""Largest number of lines of a file; DSO's format has four."""


def _lines(content: Content) -> list[tuple[int, list[str]]]:
    """Returns the lines with words, with their numbers counted from 1; no line of a text longer than _MAX_LINES."""
    if not 0 < len(content.words) <= 4096:
        return []
    lines = enumerate(content.words.splitlines(), 1)
    found = [(n, line.split()) for n, line in lines if line.strip() and not line.lstrip().startswith("#")]
    return found if len(found) <= _MAX_LINES else []


def _recognises(content: Content) -> bool:
    lines = _lines(content)
    if len(lines) < 3 or len(lines[1][1]) != 2:
        return False
    words = lines[0][1]
    named = words[0].strip(":").lower() in _LENSES
    return (named or (len(words) == 5 and len(lines) == 4)) and _RECTIFIES.fullmatch(" ".join(lines[2][1])) is not None


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path, lines = content.path, _lines(content)
    words = lines[0][1]
    name = words[0].strip(":").lower()
    lens = _LENSES.get(name)
    if lens is None and len(words) == 5:
        lens, words = "fov", ["FOV", *words]
    values = numbers(path, lines[0][0], words[1:]).tolist()
    width, height = numbers(path, lines[1][0], lines[1][1]).tolist()
    if name == "pinhole" and not any(values[4:]):
        values = [*values[:4], 0.0]  # files of 4Seasons have more zeros
    expected = 8 if lens == "fisheye" or name == "radtan" else 5
    if len(values) != expected:
        raise InputError(f"{path} line {lines[0][0]}: {words[0]} has {expected} numbers, not {len(values)}: correct it")
    if lens == "fov" and values[4] != 0:
        raise not_supported(path, "DSO", f"its FOV lens (with {values[4]:g}, the last number of line {lines[0][0]})")
    intrinsics = values[:4]
    if intrinsics[2] < 1 and intrinsics[3] < 1:
        fx, fy, cx, cy = intrinsics
        intrinsics = [fx * width, fy * height, cx * width - CORNER_ORIGIN_PX, cy * height - CORNER_ORIGIN_PX]
    distortion = values[4:] if expected == 8 else []
    camera = lens_camera(
        content, path.stem, (width, height), intrinsics, distortion, "opencv" if lens == "fov" else str(lens)
    )
    return CalibrationFile(path, [camera])


DIALECT = Dialect(
    "dso",
    "DSO, LDSO, TUM monoVO",
    "`camera.txt`",
    "text",
    "RadTan, Pinhole, FOV, EquiDistant or KannalaBrandt, or five numbers; then the size; then crop, full or none",
    _recognises,
    _read,
)
