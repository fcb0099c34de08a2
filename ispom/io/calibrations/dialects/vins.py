"""VINS-Mono and VINS-Fusion: a camera (camodocal's `model_type`), or the settings that name the cameras' files.

Pixel (0, 0) is the centre of the top-left pixel. PINHOLE: k1 k2 p1 p2. KANNALA_BRANDT: mu mv u0 v0 are fx fy cx cy, and
k2 to k5 are the fisheye's k1 to k4. body_T_cam0, and extrinsicRotation with extrinsicTranslation, are imu_from_camera,
in metres. MEI (one mirror) and SCARAMUZZA are not supported. Source: VINS-Fusion, config and camera_models.
"""

from __future__ import annotations

from typing import Any

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.camera_info import ImageSize, values
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import (
    CalibrationFile,
    Dialect,
    lens_camera,
    mapping_in,
    not_supported,
    rigid_of_values,
    several_numbers,
    size_of_images,
)
from ispom.io.calibrations.placed import Placed, rotation_of
from ispom.io.files import confined

PROGRAM = "VINS"
_CAMERAS = tuple(f"cam{n}_calib" for n in range(4))


def _recognises(content: Content) -> bool:
    is_camera = "model_type" in content.keys and bool(content.keys & {"projection_parameters", "mirror_parameters"})
    return is_camera or "cam0_calib" in content.keys


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    if "cam0_calib" in content.keys:
        return _settings(content, size)
    camera = _camera(content, size)
    return CalibrationFile(content.path, [camera.at(_extrinsic(content))])


def _camera(content: Content, size: ImageSize | None) -> Placed:
    path, entries = content.path, content.mapping
    model = str(entries.get("model_type", "")).strip().upper()
    if model not in ("PINHOLE", "KANNALA_BRANDT"):
        raise not_supported(path, PROGRAM, f"model_type {model[:40]}")
    notes: tuple[str, ...] = ()
    if {"image_width", "image_height"} <= content.keys:
        width, height = several_numbers(path, "", entries, ("image_width", "image_height"))
    else:
        (width, height), note = size_of_images(path, size)
        notes = (note,)
    projection = mapping_in(path, "projection_parameters", entries.get("projection_parameters"))
    name = str(entries.get("camera_name") or path.stem)[:60]
    if model == "PINHOLE":
        intrinsics = several_numbers(path, "projection_parameters.", projection, ("fx", "fy", "cx", "cy"))
        distorted = mapping_in(path, "distortion_parameters", entries.get("distortion_parameters", {}))
        coefficients = several_numbers(path, "distortion_parameters.", distorted, ("k1", "k2", "p1", "p2"), 0.0)
        return lens_camera(content, name, (width, height), intrinsics, coefficients, "opencv", None, notes)
    intrinsics = several_numbers(path, "projection_parameters.", projection, ("mu", "mv", "u0", "v0"))
    coefficients = several_numbers(path, "projection_parameters.", projection, ("k2", "k3", "k4", "k5"))
    return lens_camera(content, name, (width, height), intrinsics, coefficients, "fisheye", None, notes)


def _extrinsic(content: Content) -> Pose | None:
    """Returns imu_from_camera of VINS-Mono's settings."""
    entries = content.mapping
    if not {"extrinsicRotation", "extrinsicTranslation"} <= content.keys:
        return None
    matrix = values(content.path, "extrinsicRotation", entries["extrinsicRotation"], 9).reshape(3, 3)
    translation = values(content.path, "extrinsicTranslation", entries["extrinsicTranslation"], 3)
    return Pose(rotation_of(content.path, "extrinsicRotation", matrix), translation)


def _settings(content: Content, size: ImageSize | None) -> CalibrationFile:
    """Reads the cameras' files that VINS-Fusion's settings name, from the same folder."""
    path, entries = content.path, content.mapping
    names = [key for key in _CAMERAS if key in entries]
    cameras = []
    for key in names:
        with confined((path.parent,)):
            beside = Content.of(path.parent / _file_name(content, key, entries[key]))
        if "model_type" not in beside.keys:
            raise InputError(f"{path}: {key} names {beside.path}, which has no model_type: give a camera of VINS")
        place = entries.get(f"body_T_{key.removesuffix('_calib')}")
        pose = None if place is None else rigid_of_values(path, f"body_T_{key.removesuffix('_calib')}", place)
        found = _camera(beside, size)
        cameras.append(Placed(key.removesuffix("_calib"), found.camera, pose, found.notes))
    return CalibrationFile(path, cameras)


def _file_name(content: Content, key: str, value: Any) -> str:
    if not isinstance(value, str) or not value.isprintable() or not value.strip():
        raise InputError(f"{content.path}: {key} is not the name of a file: correct it")
    return value


DIALECT = Dialect(
    "vins",
    "VINS-Mono, VINS-Fusion",
    "`cam0_pinhole.yaml`, `euroc_stereo_config.yaml`",
    "YAML",
    "model_type with projection_parameters; cam0_calib",
    _recognises,
    _read,
)
