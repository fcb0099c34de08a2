"""OpenSfM and OpenDroneMap: camera_models.json or cameras.json, cameras by name with `projection_type`.

Lengths are shares of the longer side. The origin is the middle of the image, ((width - 1) / 2, (height - 1) / 2) where
the centre of the top-left pixel is (0, 0). brown: focal_x focal_y c_x c_y k1 k2 p1 p2 k3, as OpenCV's; perspective,
radial and simple_radial: k1 k2; fisheye: k1 k2 of the angle; fisheye_opencv: k1 to k4. fisheye62, fisheye624, dual and
spherical cameras are not supported. Source: OpenSfM, doc/source/geometry.rst and dataset.rst.
"""

from __future__ import annotations

from typing import Any

from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import (
    CalibrationFile,
    Dialect,
    lens_camera,
    not_supported,
    one_number,
    several_numbers,
)
from ispom.io.calibrations.placed import Placed

_FISHEYE, _PERSPECTIVE = ("fisheye", "fisheye_opencv"), ("perspective", "simple_radial", "radial", "brown")
_NAMES = {"simple_radial": ("k1",), "brown": ("k1", "k2", "p1", "p2", "k3"), "fisheye_opencv": ("k1", "k2", "k3", "k4")}


def _cameras(content: Content) -> dict[str, dict[Any, Any]]:
    return {str(name): each for name, each in content.mapping.items() if isinstance(each, dict)}


def _recognises(content: Content) -> bool:
    cameras = _cameras(content)
    return bool(cameras) and all("projection_type" in each for each in cameras.values())


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    return CalibrationFile(content.path, [_camera(content, name, each) for name, each in _cameras(content).items()])


def _camera(content: Content, name: str, values: dict[Any, Any]) -> Placed:
    path, where = content.path, f"{name[:60]}."
    kind = str(values.get("projection_type")).strip().lower()
    if kind not in _FISHEYE + _PERSPECTIVE:
        raise not_supported(path, "OpenSfM", f"projection_type {kind[:40]}")
    width, height = several_numbers(path, where, values, ("width", "height"))
    longer = max(width, height)
    fx = one_number(path, where, values, "focal_x" if "focal_x" in values else "focal") * longer
    fy = one_number(path, where, values, "focal_y") * longer if "focal_y" in values else fx
    cx, cy = several_numbers(path, where, values, ("c_x", "c_y"), 0.0)
    coefficients = several_numbers(path, where, values, _NAMES.get(kind, ("k1", "k2")), 0.0)
    if kind == "fisheye_opencv" and any(several_numbers(path, where, values, ("p1", "p2"), 0.0)):
        raise not_supported(path, "OpenSfM", "p1 and p2 of a fisheye lens")
    coefficients += [0.0] * (4 - len(coefficients))
    intrinsics = [fx, fy, cx * longer + (width - 1) / 2, cy * longer + (height - 1) / 2]
    lens = "fisheye" if kind in _FISHEYE else "opencv"
    return lens_camera(content, name[:60], (width, height), intrinsics, coefficients, lens, None, (), name[:60])


DIALECT = Dialect(
    "opensfm",
    "OpenSfM, OpenDroneMap",
    "`camera_models.json`, `cameras.json`",
    "JSON",
    "projection_type of each camera",
    _recognises,
    _read,
)
