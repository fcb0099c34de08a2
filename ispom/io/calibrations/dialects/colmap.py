"""COLMAP's cameras.txt and cameras.bin: cameras with a model, a size and its parameters; also the folder sparse/0 of
them.

The corner of the top-left pixel is (0, 0), so that half a pixel is subtracted. Parameters: f or fx fy, cx cy, then k
(k1 k2 of RADIAL, OpenCV's order of OPENCV and FULL_OPENCV, k1 to k4 of OPENCV_FISHEYE). Cameras have no poses here:
those in images.txt are poses of a recording. FOV, THIN_PRISM_FISHEYE, division and other models are not supported.
Source: COLMAP, doc/format.rst, doc/cameras.rst and src/colmap/sensor/models.h.
"""

from __future__ import annotations

import re
import struct

from ispom.errors import InputError
from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CalibrationFile, Dialect
from ispom.io.calibrations.placed import placed
from ispom.io.colmap import COUNTS, colmap_camera, read_colmap_cameras
from ispom.types import Camera

_LINE = re.compile(r"^\s*\d{1,10}[ \t]+([A-Z][A-Z_0-9]{2,30})[ \t]+\d{1,6}[ \t]+\d{1,6}(?:[ \t]|$)", re.MULTILINE)
_HEAD = re.compile(r"^#.*\bCAMERA_ID\b.*\bMODEL\b", re.MULTILINE)
MODELS = (
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV",
    "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE", "SIMPLE_DIVISION",
    "DIVISION", "SIMPLE_FISHEYE", "FISHEYE", "EUCM", "EQUIRECTANGULAR",
)  # fmt: skip
"""Models in the order of their numbers in cameras.bin."""
UNSUPPORTED_COUNTS = {
    "FOV": 5, "THIN_PRISM_FISHEYE": 12, "RAD_TAN_THIN_PRISM_FISHEYE": 16, "SIMPLE_DIVISION": 4, "DIVISION": 5,
    "EUCM": 6, "EQUIRECTANGULAR": 0,
}  # fmt: skip
"""Numbers of parameters of the models that are not supported."""
MAX_CAMERAS = 100_000
"""Largest number of cameras of a file."""
_COUNT, _CAMERA = struct.Struct("<Q"), struct.Struct("<iiQQ")


def _recognises(content: Content) -> bool:
    if content.text is not None and not content.data.startswith(b"\0"):
        return _HEAD.search(content.words[:4000]) is not None or _LINE.search(content.words[:4000]) is not None
    return _is_binary(content.data)


def _is_binary(data: bytes) -> bool:
    if len(data) < _COUNT.size + _CAMERA.size:
        return False
    (count,) = _COUNT.unpack_from(data)
    _, model, width, height = _CAMERA.unpack_from(data, _COUNT.size)
    plausible = 1 <= count <= MAX_CAMERAS and 0 <= model < 64 and 0 < width < 1 << 17 and 0 < height < 1 << 17
    return plausible and len(data) >= _COUNT.size + count * _CAMERA.size


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path = content.path
    cameras = read_colmap_cameras(path) if not _is_binary(content.data) else _of_binary(content)
    name = path.stem
    several = len(cameras) > 1
    found = [
        placed(path, f"camera {n}" if several else "", f"{name} {n}" if several else name, camera, None)
        for n, camera in enumerate(cameras, 1)
    ]
    return CalibrationFile(path, found)


def _of_binary(content: Content) -> list[Camera]:
    path, data, out = content.path, content.data, []
    (count,) = _COUNT.unpack_from(data)
    place = _COUNT.size
    for n in range(count):
        if place + _CAMERA.size > len(data):
            raise InputError(f"{path} ends in camera {n + 1} of {count}: restore the file")
        _, number, width, height = _CAMERA.unpack_from(data, place)
        place += _CAMERA.size
        if not 0 <= number < len(MODELS):
            raise InputError(f"{path}: camera {n + 1} has model {number}, which no known version of COLMAP has")
        model = MODELS[number]
        used = COUNTS.get(model, UNSUPPORTED_COUNTS.get(model, 0))
        if place + 8 * used > len(data):
            raise InputError(f"{path} ends in camera {n + 1} of {count}: restore the file")
        values = struct.unpack_from(f"<{used}d", data, place)
        place += 8 * used
        out.append(colmap_camera(path, f"camera {n + 1}", model, [float(width), float(height), *values]))
    if place != len(data):
        raise InputError(f"{path} goes on after its {count} cameras: restore the file")
    return out


DIALECT = Dialect(
    "colmap",
    "COLMAP",
    "`cameras.txt`, `cameras.bin`, `sparse/0`",
    "text",
    "CAMERA_ID MODEL WIDTH HEIGHT PARAMS",
    _recognises,
    _read,
)
