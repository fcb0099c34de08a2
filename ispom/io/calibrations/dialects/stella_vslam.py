"""Settings of stella_vslam and OpenVSLAM, dotted (`Camera.model: perspective`) or nested (`Camera: {model: ...}`).

Pixel (0, 0) is the centre of the top-left pixel. Coefficients: k1 k2 p1 p2 k3 (perspective) or k1 to k4 (fisheye).
focal_x_baseline is fx times the baseline [m], of setup stereo only: of RGBD it is no second camera. With
StereoRectifier the images are as recorded: K, D and R of each side, R being rectified_from_raw. fps counts where the
images have no times. Equirectangular images and radial_division are not supported. Source: stella_vslam, example/euroc
and src/stella_vslam/camera.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import (
    CalibrationFile,
    Dialect,
    lens_camera,
    mapping_in,
    not_supported,
    one_number,
    pair,
    several_numbers,
    size_of_images,
)
from ispom.io.calibrations.dialects.orbslam import STELLA_VSLAM_KEYS, rate_entry
from ispom.io.calibrations.placed import Placed, rotation_of
from ispom.io.camera import intrinsics_of
from ispom.io.mapping import finite_numbers

PROGRAM = "stella_vslam"


def _recognises(content: Content) -> bool:
    nested = content.mapping.get("Camera")
    return bool(content.keys & STELLA_VSLAM_KEYS) or (
        isinstance(nested, dict) and bool({"model", "setup"} & set(nested)) and "name" in nested
    )


def _section(content: Content, name: str) -> dict[Any, Any]:
    """Returns the entries below `name`, nested or dotted."""
    nested = content.mapping.get(name)
    if nested is not None:
        return mapping_in(content.path, name, nested)
    start = f"{name}."
    return {key.removeprefix(start): content.mapping[key] for key in content.keys if key.startswith(start)}


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    values = _section(content, "Camera")
    model, setup = (str(values.get(key, "")).strip().lower() for key in ("model", "setup"))
    if model not in ("", "perspective", "fisheye"):
        raise not_supported(content.path, PROGRAM, f"Camera.model {model[:40]}")
    if not model and "k4" in values:
        raise InputError(f"{content.path}: Camera.model is missing, and k4 may be that of a fisheye: add it")
    notes: tuple[str, ...] = ()
    if {"cols", "rows"} <= set(values):
        width, height = several_numbers(content.path, "Camera.", values, ("cols", "rows"))
    else:
        (width, height), note = size_of_images(content.path, size)
        notes = (note,)
    lens = "fisheye" if model == "fisheye" else "opencv"
    names = ("k1", "k2", "k3", "k4") if lens == "fisheye" else ("k1", "k2", "p1", "p2", "k3")
    distortion = several_numbers(content.path, "Camera.", values, names, 0.0)
    intrinsics = several_numbers(content.path, "Camera.", values, ("fx", "fy", "cx", "cy"))
    camera = lens_camera(
        content, content.path.stem, (width, height), intrinsics, distortion, lens, None, notes, "Camera"
    )
    if setup != "stereo":
        return CalibrationFile(content.path, [camera], entries=rate_entry(content, "fps", values))
    baseline = one_number(content.path, "Camera.", values, "focal_x_baseline") / intrinsics[0]
    raw = _section(content, "StereoRectifier")
    if raw:
        poses = [_rotation(content, raw, side) for side in ("left", "right")]
        left, right = (_raw(content, raw, side, (width, height)) for side in ("left", "right"))
        rectified = [Pose(poses[0]), Pose(poses[1], np.array([baseline, 0.0, 0.0]))]
        return CalibrationFile(content.path, [left.at(rectified[0]), right.at(rectified[1])], is_relative=True)
    left, right = (Placed(side, camera.camera, None, camera.notes) for side in ("left", "right"))
    return pair(content, left, right, Pose(translation=np.array([baseline, 0.0, 0.0])))


def _rotation(content: Content, raw: dict[Any, Any], side: str) -> Array:
    where = f"StereoRectifier.R_{side}"
    matrix = np.array(finite_numbers(content.path, where, raw.get(f"R_{side}"), 9)).reshape(3, 3)
    return rotation_of(content.path, where, matrix)


def _raw(content: Content, raw: dict[Any, Any], side: str, size: tuple[float, float]) -> Placed:
    where = f"StereoRectifier.K_{side}"
    matrix = np.array(finite_numbers(content.path, where, raw.get(f"K_{side}"), 9)).reshape(3, 3)
    intrinsics, notes = intrinsics_of(content.path, where, matrix)
    lens = "fisheye" if str(raw.get("model", "")).strip().lower() == "fisheye" else "opencv"
    distortion = finite_numbers(content.path, f"StereoRectifier.D_{side}", raw.get(f"D_{side}", []), (0, 4, 5, 8))
    return lens_camera(content, side, size, intrinsics, distortion, lens, None, notes, where)


DIALECT = Dialect(
    "stella_vslam",
    "stella_vslam, OpenVSLAM",
    "`config.yaml`",
    "YAML",
    "Camera.model or Camera.setup; Camera with them",
    _recognises,
    _read,
)
