"""mrcal's .cameramodel: one camera with `lensmodel`, `intrinsics`, `extrinsics` and `imagersize`.

Pixel (0, 0) is the centre of the top-left pixel. intrinsics are fx fy cx cy and OpenCV's coefficients of
LENSMODEL_OPENCV4, 5, 8 and 12 (k1 k2 p1 p2 k3 to k6, thin prism, which must be 0); LENSMODEL_PINHOLE has none.
extrinsics (rt_cam_ref of newer versions) is camera_from_reference, a rotation vector and a translation in metres; files
of several cameras have one reference. CAHVOR, splined and other models are not supported. The file is read as data, not
run. Source: mrcal, "cameramodel" and mrcal/cameramodel.py.
"""

from __future__ import annotations

import re

from ispom.errors import InputError
from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import (
    CalibrationFile,
    Dialect,
    lens_camera,
    not_supported,
    pose_of_rotvec,
)
from ispom.io.mapping import MAX_BYTES, finite_numbers, mapping_of

_INPUTS = re.compile(r"['\"]optimization_inputs['\"]\s*:\s*b?(?:'[^']*'|\"[^\"]*\")\s*,?")
"""The inputs of mrcal's optimisation, which are large and not part of the calibration."""
_COUNTS = {"PINHOLE": 4, "OPENCV4": 8, "OPENCV5": 9, "OPENCV8": 12, "OPENCV12": 16}


_MODEL = re.compile(r"['\"](?:LENSMODEL|DISTORTION)_[\w=.+-]{1,200}['\"]")
_NUMBERS = re.compile(r"['\"]intrinsics['\"]\s*:")


def _recognises(content: Content) -> bool:
    return _MODEL.search(content.words[:4000]) is not None and _NUMBERS.search(content.words) is not None


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path = content.path
    text = _INPUTS.sub("", content.words)
    if len(text) > MAX_BYTES:
        raise InputError(
            f"{path} is larger than {MAX_BYTES >> 10} kB, more than such a file holds: give the right file"
        )
    values = mapping_of(path, text)
    named = values.get("lensmodel", values.get("lens_model", values.get("distortion_model", "")))
    model = str(named).replace("DISTORTION_NONE", "LENSMODEL_PINHOLE").replace("DISTORTION_", "LENSMODEL_")
    kind = model.removeprefix("LENSMODEL_")
    if kind not in _COUNTS:
        raise not_supported(path, "mrcal", model[:60])
    intrinsics = finite_numbers(path, "intrinsics", values.get("intrinsics"), _COUNTS[kind])
    sides = finite_numbers(path, "imagersize", values.get("imagersize"), 2)
    key = "rt_cam_ref" if "rt_cam_ref" in values else "extrinsics"
    pose = None
    if key in values:
        pose = pose_of_rotvec(path, key, finite_numbers(path, key, values[key], 6)).inverse()
    camera = lens_camera(content, path.stem, (sides[0], sides[1]), intrinsics[:4], intrinsics[4:], "opencv", pose)
    return CalibrationFile(path, [camera], is_relative=True)


DIALECT = Dialect(
    "mrcal", "mrcal", "`camera-0.cameramodel`", "text", "LENSMODEL_... with intrinsics", _recognises, _read
)
