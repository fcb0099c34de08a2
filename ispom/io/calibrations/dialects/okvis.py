"""OKVIS and OKVIS2: `cameras`, a list with `T_SC`, `image_dimension`, `focal_length` and `principal_point`.

Pixel (0, 0) is the centre of the top-left pixel. Coefficients: k1 k2 p1 p2 (radialtangential), k1 k2 p1 p2 k3 to k6
(radialtangential8) or k1 to k4 (equidistant). T_SC is imu_from_camera (16 numbers, by rows), in metres. Source: OKVIS,
config/config_fpga_p2_euroc.yaml and okvis_cv.
"""

from __future__ import annotations

from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import (
    CalibrationFile,
    Dialect,
    lens_camera,
    list_in,
    mapping_in,
    not_supported,
    rigid_of_values,
)
from ispom.io.mapping import finite_numbers

_LENSES = {"radialtangential": "opencv", "radialtangential8": "opencv", "equidistant": "fisheye", "none": "opencv"}


def _recognises(content: Content) -> bool:
    cameras = content.mapping.get("cameras")
    return isinstance(cameras, list) and any(isinstance(each, dict) and "T_SC" in each for each in cameras)


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path, found = content.path, []
    for n, each in enumerate(list_in(path, "cameras", content.mapping["cameras"])):
        where = f"cameras[{n}]"
        values = mapping_in(path, where, each)
        word = str(values.get("distortion_type", "none")).strip().lower()
        if word not in _LENSES:
            raise not_supported(path, "OKVIS", f"distortion_type {word[:40]}")
        sides = finite_numbers(path, f"{where}.image_dimension", values.get("image_dimension"), 2)
        focal = finite_numbers(path, f"{where}.focal_length", values.get("focal_length"), 2)
        centre = finite_numbers(path, f"{where}.principal_point", values.get("principal_point"), 2)
        distortion = finite_numbers(
            path, f"{where}.distortion_coefficients", values.get("distortion_coefficients", []), (0, 4, 5, 8)
        )
        pose = rigid_of_values(path, f"{where}.T_SC", values.get("T_SC"))
        size_px = (sides[0], sides[1])
        found.append(
            lens_camera(content, f"cam{n}", size_px, [*focal, *centre], distortion, _LENSES[word], pose, (), where)
        )
    return CalibrationFile(path, found)


DIALECT = Dialect("okvis", "OKVIS, OKVIS2", "`config.yaml`", "YAML", "cameras with T_SC", _recognises, _read)
