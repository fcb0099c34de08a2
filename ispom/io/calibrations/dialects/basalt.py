"""Basalt: `value0` with `intrinsics`, `resolution` and `T_imu_cam` for each camera; also of Monado and its data sets.

Pixel (0, 0) is the centre of the top-left pixel. kb4: fx fy cx cy k1 to k4, the fisheye here; pinhole: none;
pinhole-radtan8: k1 k2 p1 p2 k3 to k6. T_imu_cam is imu_from_camera, px py pz [m] and a quaternion qx qy qz qw. ds,
eucm, ucm and fov are not supported without a package. Source: Basalt, doc/Calibration.md and basalt-headers,
calibration.hpp.
"""

from __future__ import annotations

from ispom.errors import InputError
from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import (
    CalibrationFile,
    Dialect,
    lens_camera,
    list_in,
    mapping_in,
    not_supported,
    pose_of_quaternion,
    several_numbers,
)
from ispom.io.mapping import finite_numbers

_LENSES = {"kb4": "fisheye", "pinhole": "opencv", "pinhole-radtan8": "opencv"}
_NAMES = {
    "kb4": ("k1", "k2", "k3", "k4"), "pinhole": (), "pinhole-radtan8": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}  # fmt: skip


def _recognises(content: Content) -> bool:
    inner = content.mapping.get("value0")
    return isinstance(inner, dict) and "intrinsics" in inner


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path, value = content.path, content.mapping["value0"]
    intrinsics = list_in(path, "intrinsics", value["intrinsics"])
    sizes = list_in(path, "resolution", value.get("resolution"))
    poses = value.get("T_imu_cam") or []
    if len(sizes) != len(intrinsics) or (poses and len(poses) != len(intrinsics)):
        raise InputError(f"{path}: it has {len(intrinsics)} intrinsics, but {len(sizes)} sizes and {len(poses)} poses")
    found = []
    for n, each in enumerate(intrinsics):
        where = f"intrinsics[{n}]"
        entry = mapping_in(path, where, each)
        kind = str(entry.get("camera_type", "")).strip().lower()
        if kind not in _LENSES:
            raise not_supported(path, "Basalt", f"camera_type {kind[:40]}")
        values = mapping_in(path, f"{where}.intrinsics", entry.get("intrinsics"))
        focal = several_numbers(path, f"{where}.intrinsics.", values, ("fx", "fy", "cx", "cy"))
        coefficients = several_numbers(path, f"{where}.intrinsics.", values, _NAMES[kind], 0.0)
        sides = finite_numbers(path, f"resolution[{n}]", sizes[n], 2)
        pose = None
        if poses:
            place = mapping_in(path, f"T_imu_cam[{n}]", poses[n])
            xyz, xyzw = (
                several_numbers(path, f"T_imu_cam[{n}].", place, names)
                for names in (("px", "py", "pz"), ("qx", "qy", "qz", "qw"))
            )
            pose = pose_of_quaternion(path, f"T_imu_cam[{n}]", xyzw, xyz)
        size_px = (sides[0], sides[1])
        found.append(lens_camera(content, f"cam{n}", size_px, focal, coefficients, _LENSES[kind], pose, (), where))
    return CalibrationFile(path, found)


DIALECT = Dialect("basalt", "Basalt", "`calibration.json`", "JSON", "value0 with intrinsics", _recognises, _read)
