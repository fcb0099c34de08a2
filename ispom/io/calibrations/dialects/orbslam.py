"""Settings of ORB-SLAM2, ORB-SLAM3 and pySLAM: `Camera.fx` or `Camera1.fx`, a pair by `Camera.bf`, `Stereo.b`,
`Stereo.T_c1_c2`, `Tlr`, or raw images by LEFT.K ... RIGHT.P.

Pixel (0, 0) is the centre of the top-left pixel, as the values are given to OpenCV. Coefficients: k1 k2 p1 p2 [k3], or
k1 to k4 of Camera.type KannalaBrandt8. Camera.bf is fx times the baseline [m]; Stereo.b is the baseline [m];
Stereo.T_c1_c2 and Tlr are left_from_right (x_1 = T x_2), in metres. Camera.bf of an RGB-D camera (with DepthMapFactor)
is no second camera. Camera.fps counts where the images have no times. Source: ORB_SLAM3, src/Settings.cc; ORB_SLAM2,
Examples/Stereo.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.camera_info import ImageSize, camera_info
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import (
    NOMINAL_RATE,
    CalibrationFile,
    Dialect,
    lens_camera,
    not_supported,
    one_number,
    pair,
    rigid_of_values,
    several_numbers,
    size_of_images,
)
from ispom.io.calibrations.placed import Placed, placed

PROGRAM = "ORB-SLAM"
_DEPTH = ("DepthMapFactor", "RGBD.DepthMapFactor", "depth_map_factor")
_INTRINSICS = ("fx", "fy", "cx", "cy")
_PERSPECTIVE = {"", "pinhole", "rectified", "perspective"}

STELLA_VSLAM_KEYS = frozenset(f"Camera.{name}" for name in ("model", "setup", "cols", "rows", "color_order"))
"""Entries by which a file is one of stella_vslam."""


def _recognises(content: Content) -> bool:
    return bool(content.keys & {"Camera.fx", "Camera1.fx"}) and not content.keys & STELLA_VSLAM_KEYS


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    values = content.mapping
    prefix = "Camera1." if "Camera1.fx" in values else "Camera."
    word = re.sub(r"[^a-z0-9]", "", str(values.get("Camera.type", "")).lower())
    if word not in _PERSPECTIVE and not word.startswith("kannalabrandt"):
        raise not_supported(content.path, PROGRAM, f"Camera.type {str(values.get('Camera.type'))[:40]}")
    entries = rate_entry(content, "Camera.fps")
    is_raw = {"LEFT.K", "RIGHT.K", "LEFT.P", "RIGHT.P"} <= content.keys
    if is_raw:
        return _raw_pair(content, size)
    sides, notes = _size(content, size)
    lens = "fisheye" if word.startswith("kannala") else "opencv"
    first = _camera(content, prefix, "left", sides, lens, notes, word)
    has_depth = any(key in values for key in _DEPTH)
    baseline = None if has_depth else _baseline(content, prefix)
    extrinsics = next((key for key in ("Stereo.T_c1_c2", "Tlr") if key in values), None)
    if extrinsics is not None and "Camera2.fx" in values:
        second = _camera(content, "Camera2.", "right", sides, lens, (), word)
        return pair(content, first, second, rigid_of_values(content.path, extrinsics, values[extrinsics]))
    if "Camera2.fx" in values:
        raise InputError(f"{content.path}: Camera2 has no place: add Stereo.T_c1_c2, its pose in the first camera")
    if baseline is not None:
        second = _camera(content, prefix, "right", sides, lens, (), word)
        return pair(content, first, second, Pose(translation=np.array([baseline, 0.0, 0.0])))
    alone = Placed(content.path.stem, first.camera, None, first.notes)
    return CalibrationFile(content.path, [alone], entries=entries)


def rate_entry(content: Content, key: str, values: dict[Any, Any] | None = None) -> dict[Any, Any]:
    """Returns the entry of a rate; none where the file has no usable one."""
    rate = (content.mapping if values is None else values).get(key)
    usable = isinstance(rate, int | float) and not isinstance(rate, bool) and 1e-3 <= rate <= 1e5
    return {NOMINAL_RATE: float(rate)} if usable else {}  # type: ignore[arg-type]


def _size(content: Content, size: ImageSize | None) -> tuple[tuple[float, float], tuple[str, ...]]:
    if {"Camera.width", "Camera.height"} <= content.keys:
        width, height = several_numbers(content.path, "Camera.", _below(content, "Camera."), ("width", "height"))
        return (width, height), ()
    sides, note = size_of_images(content.path, size)
    return sides, (note,)


def _below(content: Content, prefix: str) -> dict[str, Any]:
    """Returns the entries whose names begin with `prefix`, without it."""
    return {key.removeprefix(prefix): content.mapping[key] for key in content.keys if key.startswith(prefix)}


def _camera(
    content: Content, prefix: str, name: str, size: tuple[float, float], lens: str, notes: tuple[str, ...], word: str
) -> Placed:
    values = _below(content, prefix)
    names = ("k1", "k2", "k3", "k4") if lens == "fisheye" else ("k1", "k2", "p1", "p2", "k3")
    distortion = several_numbers(content.path, prefix, values, names, 0.0)
    if word == "rectified":
        distortion = []
    intrinsics = several_numbers(content.path, prefix, values, _INTRINSICS)
    return lens_camera(content, name, size, intrinsics, distortion, lens, None, notes, prefix.rstrip("."))


def _baseline(content: Content, prefix: str) -> float | None:
    """Returns the baseline [m]; None for one camera."""
    values = content.mapping
    if "Stereo.b" in values:
        return one_number(content.path, "", values, "Stereo.b")
    if "Camera.bf" not in values:
        return None
    fx = one_number(content.path, prefix, _below(content, prefix), "fx")
    return one_number(content.path, "", values, "Camera.bf") / fx if fx else None


def _raw_pair(content: Content, size: ImageSize | None) -> CalibrationFile:
    """Reads a pair of unrectified images with their rectification; Camera.fx is that of the rectified images."""
    cameras = []
    for side in ("LEFT", "RIGHT"):
        values = _below(content, f"{side}.")
        info = camera_info(content.path, values, "", f"{side}.", size)
        cameras.append(placed(content.path, side, side.lower(), info.raw, info.pair_from_camera, info.notes))
    return CalibrationFile(content.path, cameras, is_relative=True)


DIALECT = Dialect(
    "orbslam",
    "ORB-SLAM2, ORB-SLAM3, pySLAM",
    "`EuRoC.yaml`, `KITTI00-02.yaml`",
    "YAML",
    "Camera.fx or Camera1.fx",
    _recognises,
    _read,
)
