"""calib.io's Calibrator and libCalib: the JSON with `Calibration`, `cameras`, `model` and `transform`.

Pixel (0, 0) is the centre of the top-left pixel. fx = f, fy = f ar. Coefficients by name, as OpenCV's: k1 to k6, p1 p2,
and s1 to s4, tauX, tauY, which must be 0; those of a fisheye (Kannala-Brandt) are k1 to k4. transform is
camera_from_reference, a rotation vector rx ry rz and a translation in metres. Other models are not supported. Source:
calib.io's public example readCalibParameters.cpp.
"""

from __future__ import annotations

from typing import Any

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
    one_number,
    pose_of_rotvec,
    several_numbers,
)
from ispom.io.calibrations.placed import Placed

_PERSPECTIVE = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tauX", "tauY")
_MAX_DEPTH = 8
"""Largest number of base classes that are searched for imageSize."""


def _recognises(content: Content) -> bool:
    inner = content.mapping.get("Calibration")
    cameras = inner.get("cameras") if isinstance(inner, dict) else None
    return isinstance(cameras, list) and bool(cameras) and isinstance(cameras[0], dict) and "model" in cameras[0]


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path, found, name = content.path, [], ""
    for n, each in enumerate(list_in(path, "cameras", content.mapping["Calibration"]["cameras"])):
        camera = mapping_in(path, f"cameras[{n}]", each)
        model = mapping_in(path, f"cameras[{n}].model", camera.get("model"))
        name = str(model.get("polymorphic_name", name))  # which is written where a model is the first of its kind
        found.append(_camera(content, n, camera, model, name.rsplit(":", 1)[-1]))
    return CalibrationFile(path, found, is_relative=True)


def _camera(content: Content, n: int, camera: dict[Any, Any], model: dict[Any, Any], name: str) -> Placed:
    path, where = content.path, f"cameras[{n}]"
    is_fisheye = "fisheye" in name.lower() or "kannala" in name.lower()
    if name != "CameraModelOpenCV" and not is_fisheye:
        raise not_supported(path, "calib.io", f"{name[:60] or 'a model without a name'}")
    wrapper = mapping_in(path, f"{where}.model.ptr_wrapper", model.get("ptr_wrapper"))
    data = mapping_in(path, f"{where}.model.ptr_wrapper.data", wrapper.get("data"))
    parameters = mapping_in(path, f"{where}: parameters", data.get("parameters"))
    values = {key: each.get("val") if isinstance(each, dict) else each for key, each in parameters.items()}
    sides = _size(data)
    if sides is None:
        raise InputError(f"{path}: {where} has no imageSize: export the calibration again")
    width, height = several_numbers(path, f"{where}: imageSize.", sides, ("width", "height"))
    f, aspect = one_number(path, f"{where}: ", values, "f"), one_number(path, f"{where}: ", values, "ar", 1.0)
    cx, cy = several_numbers(path, f"{where}: ", values, ("cx", "cy"))
    names = ("k1", "k2", "k3", "k4") if is_fisheye else _PERSPECTIVE
    coefficients = several_numbers(path, f"{where}: ", values, names, 0.0)
    pose = None
    if "transform" in camera:
        transform = mapping_in(path, f"{where}.transform", camera["transform"])
        turn = mapping_in(path, f"{where}.transform.rotation", transform.get("rotation"))
        shift = mapping_in(path, f"{where}.transform.translation", transform.get("translation"))
        numbers = several_numbers(path, f"{where}.transform.rotation.", turn, ("rx", "ry", "rz"))
        numbers += several_numbers(path, f"{where}.transform.translation.", shift, ("x", "y", "z"))
        pose = pose_of_rotvec(path, f"{where}.transform", numbers).inverse()
    lens = "fisheye" if is_fisheye else "opencv"
    intrinsics = [f, f * aspect, cx, cy]
    return lens_camera(content, f"cam{n}", (width, height), intrinsics, coefficients, lens, pose, (), where)


def _size(data: dict[Any, Any], depth: int = 0) -> dict[Any, Any] | None:
    """Returns imageSize, which is in the data of a base class of the model."""
    if isinstance(data.get("imageSize"), dict):
        return data["imageSize"]
    if depth > _MAX_DEPTH:
        return None
    inner = (_size(each, depth + 1) for each in data.values() if isinstance(each, dict))
    return next((size for size in inner if size is not None), None)


DIALECT = Dialect(
    "calibio", "calib.io, libCalib", "`calibration.json`", "JSON", "Calibration with cameras", _recognises, _read
)
