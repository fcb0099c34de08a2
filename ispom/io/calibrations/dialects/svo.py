"""SVO's ncamera (rpg_svo_pro, aslam): `cameras`, a list with `camera` and `T_B_C`.

Pixel (0, 0) is the centre of the top-left pixel. intrinsics are fx fy cx cy. Coefficients: k1 k2 p1 p2
(radial-tangential) or k1 to k4 (equidistant). T_B_C is body_from_camera (the IMU), in metres. fov, omni and others are
not supported. Source: rpg_svo_pro_open, svo_ros/param/calib/euroc_stereo.yaml.
"""

from __future__ import annotations

from ispom.io.calibrations.camera_info import ImageSize, values
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import (
    CalibrationFile,
    Dialect,
    lens_camera,
    list_in,
    mapping_in,
    not_supported,
    rigid_of_values,
    several_numbers,
)
from ispom.io.mapping import finite_numbers

_LENSES = {"none": "opencv", "radial-tangential": "opencv", "radtan": "opencv", "equidistant": "fisheye"}


def _recognises(content: Content) -> bool:
    cameras = content.mapping.get("cameras")
    return isinstance(cameras, list) and any(isinstance(each, dict) and "T_B_C" in each for each in cameras)


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path, found = content.path, []
    for n, each in enumerate(list_in(path, "cameras", content.mapping["cameras"])):
        where = f"cameras[{n}]"
        outer = mapping_in(path, where, each)
        camera = mapping_in(path, f"{where}.camera", outer.get("camera"))
        if str(camera.get("type", "pinhole")).strip().lower() != "pinhole":
            raise not_supported(path, "SVO", f"camera type {str(camera.get('type'))[:40]}")
        distortion = mapping_in(path, f"{where}.distortion", camera.get("distortion", {}))
        word = str(distortion.get("type", "none")).strip().lower()
        if word not in _LENSES:
            raise not_supported(path, "SVO", f"distortion type {word[:40]}")
        intrinsics = values(path, f"{where}.intrinsics", camera.get("intrinsics"), 4).tolist()
        parameters = distortion.get("parameters", [])
        parameters = parameters.get("data") if isinstance(parameters, dict) else parameters
        coefficients = finite_numbers(path, f"{where}.distortion.parameters", parameters or [], (0, 4, 5, 8))
        width, height = several_numbers(path, f"{where}.", camera, ("image_width", "image_height"))
        pose = rigid_of_values(path, f"{where}.T_B_C", outer.get("T_B_C"))
        found.append(
            lens_camera(content, f"cam{n}", (width, height), intrinsics, coefficients, _LENSES[word], pose, (), where)
        )
    return CalibrationFile(path, found)


DIALECT = Dialect("svo", "SVO", "`calib.yaml`", "YAML", "cameras with T_B_C", _recognises, _read)
