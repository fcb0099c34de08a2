"""cuVSLAM's edex: a list whose first entry has `cameras` with `intrinsics` and `transform`.

Pixel (0, 0) is the centre of the top-left pixel. Coefficients: brown5k k1 k2 k3 p1 p2, fisheye4 k1 to k4, polynomial k1
k2 p1 p2 k3 to k6. transform is rig_from_camera (3 rows of 4) in axes x right, y up, z backwards, in metres: it is
turned to ours on both sides. Source: cuVSLAM, cuvslam2.h and common/coordinate_system.h (LegacyEdexIsometryToOpenCV).
"""

from __future__ import annotations

import numpy as np

from ispom.geometry import Pose
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

_COUNTS = {"pinhole": 0, "brown5k": 5, "fisheye4": 4, "fisheye": 4, "polynomial": 8}
_FLIPPED = np.diag([1.0, -1.0, -1.0])
"""Between axes x right, y down, z forward, and x right, y up, z backwards."""


def _recognises(content: Content) -> bool:
    first = content.values[0] if isinstance(content.values, list) and content.values else content.values
    cameras = first.get("cameras") if isinstance(first, dict) else None
    return isinstance(cameras, list) and any(
        isinstance(each, dict) and {"intrinsics", "transform"} <= set(each) for each in cameras
    )


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path, found = content.path, []
    first = content.values[0] if isinstance(content.values, list) else content.values
    for n, each in enumerate(list_in(path, "cameras", first["cameras"])):
        where = f"cameras[{n}]"
        camera = mapping_in(path, where, each)
        values = mapping_in(path, f"{where}.intrinsics", camera.get("intrinsics"))
        word = str(values.get("distortion_model", "pinhole")).strip().lower()
        if word not in _COUNTS:
            raise not_supported(path, "cuVSLAM", f"distortion_model {word[:40]}")
        sides = finite_numbers(path, f"{where}.intrinsics.size", values.get("size"), 2)
        focal = finite_numbers(path, f"{where}.intrinsics.focal", values.get("focal"), 2)
        centre = finite_numbers(path, f"{where}.intrinsics.principal", values.get("principal"), 2)
        listed = values.get("distortion_params") or []
        coefficients = finite_numbers(path, f"{where}.intrinsics.distortion_params", listed, (0, _COUNTS[word]))
        if word == "pinhole":
            coefficients = []
        elif word == "brown5k" and coefficients:
            coefficients = [*coefficients[:2], *coefficients[3:], coefficients[2]]
        pose = rigid_of_values(path, f"{where}.transform", camera.get("transform"))
        pose = Pose(_FLIPPED @ pose.rotation @ _FLIPPED, _FLIPPED @ pose.translation)
        lens = "fisheye" if word.startswith("fisheye") else "opencv"
        size_px = (sides[0], sides[1])
        found.append(lens_camera(content, f"cam{n}", size_px, [*focal, *centre], coefficients, lens, pose, (), where))
    return CalibrationFile(path, found)


DIALECT = Dialect(
    "cuvslam", "cuVSLAM", "`stereo.edex`", "JSON", "cameras with intrinsics and transform", _recognises, _read
)
