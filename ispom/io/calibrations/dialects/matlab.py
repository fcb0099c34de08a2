"""MATLAB: printed cameraParameters or cameraIntrinsics, and the Caltech toolbox's Calib_Results.m.

MATLAB counts pixels from 1: the centre of the top-left pixel, our (0, 0), is (1, 1), and 1 is subtracted; ImageSize is
rows and columns, and IntrinsicMatrix is transposed. RadialDistortion k1 k2 [k3] and TangentialDistortion p1 p2 are
OpenCV's. The Caltech toolbox (fc, cc, kc, nx, ny) counts from 0, and kc is k1 k2 p1 p2 k3; of a pair (fc_left ...), om
and T are x_right = R x_left + T in millimetres. The file is not executed. Binary .mat files are not read. Source:
MATLAB's documentation of cameraIntrinsics; J.-Y. Bouguet, Camera Calibration Toolbox, "Description of the calibration
parameters".
"""

from __future__ import annotations

import re

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import (
    CalibrationFile,
    Dialect,
    lens_camera,
    not_supported,
    pair,
    pose_of_rotvec,
    size_of_images,
)
from ispom.io.calibrations.dialects.matrix import MATLAB_ORIGIN_PX
from ispom.io.calibrations.placed import Placed
from ispom.io.camera import MAX_SKEW, intrinsics_of
from ispom.io.values import number

METRES_PER_MILLIMETRE = 1e-3
MAX_LETTERS = 256 << 10
"""Largest size of a text, which is searched by regular expressions."""
_CALTECH = re.compile(r"^\s*fc(?:_left)?\s*=", re.MULTILINE)
_PRINTED = re.compile(r"\b(?:FocalLength|IntrinsicMatrix)\b|\bcamera(?:Parameters|Intrinsics)\b")
_MAT = b"MATLAB 5.0 MAT-file"
_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"


def _recognises(content: Content) -> bool:
    if content.data.startswith(_MAT):
        return True
    if content.keys or len(content.words) > MAX_LETTERS:
        return False
    return _CALTECH.search(content.words) is not None or (
        _PRINTED.search(content.words) is not None
        and re.search(r"Matrix|PrincipalPoint|\bK\b", content.words) is not None
    )


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path = content.path
    if content.data.startswith(_MAT):
        raise not_supported(
            path, "MATLAB", "a binary .mat", "print the camera's values to a text file, or save them as CSV"
        )
    if _CALTECH.search(content.words):
        return _caltech(content, size)
    return CalibrationFile(path, [_printed(content, size)])


def _printed(content: Content, size: ImageSize | None) -> Placed:
    path = content.path
    sides, notes = _printed_size(content, size)
    matrix = _numbers(content, "IntrinsicMatrix|K", 9)
    if _numbers(content, "FocalLength", 2) is not None:
        fx, fy = _required(content, "FocalLength", 2)
        cx, cy = _required(content, "PrincipalPoint", 2)
        skew = (_numbers(content, "Skew", 1) or [0.0])[0]
        if abs(skew) > MAX_SKEW * abs(fx):
            raise InputError(f"{path}: Skew is {skew:g}, which no sensor has: correct it")
        notes += (f"{path}: the skew of {skew:g} px is skipped, as cameras here have none",) if skew else ()
        intrinsics = [fx, fy, cx, cy]
    elif matrix is not None:
        k = np.array(matrix).reshape(3, 3)
        k = k.T if k[2, :2].any() else k
        intrinsics, about = intrinsics_of(path, "the matrix", k)
        notes += about
    else:
        raise InputError(
            f"{path}: it has neither FocalLength and PrincipalPoint nor an IntrinsicMatrix: print these, too"
        )
    radial = _numbers(content, "RadialDistortion", 3) or _numbers(content, "RadialDistortion", 2) or [0.0, 0.0]
    tangential = _numbers(content, "TangentialDistortion", 2) or [0.0, 0.0]
    distortion = [*radial[:2], *tangential, *radial[2:]]
    return lens_camera(content, path.stem, sides, intrinsics, distortion, "opencv", None, notes, "", MATLAB_ORIGIN_PX)


def _printed_size(content: Content, size: ImageSize | None) -> tuple[tuple[float, float], tuple[str, ...]]:
    rows = _numbers(content, "ImageSize", 2)
    if rows is not None:
        return (rows[1], rows[0]), ()
    sides, note = size_of_images(content.path, size)
    return sides, (note,)


def _numbers(content: Content, name: str, count: int, is_line: bool = False) -> list[float] | None:
    """Returns the `count` numbers after a name (or one of several, with | between them) and its : or =, on this line or
    the next ones; None for another number of them. With `is_line`, the name must begin a line."""
    between = r"[\s,;\[\]]+"
    start = r"(?m:^)\s*" if is_line else r"\b"
    several = rf"{_NUMBER}(?:{between}{_NUMBER}){{{count - 1}}}"
    pattern = rf"{start}(?:{name})['\"]?\s*[:=,]\s*(?:\.\.\.)?[\s\[]*({several})(?!{between}{_NUMBER})"
    found = re.search(pattern, content.words)
    if found is None:
        return None
    words = re.split(r"[\s,;\[\]]+", found[1])
    return [number(f"{content.path}: {name.split('|', maxsplit=1)[0]}", word) for word in words]


def _required(content: Content, name: str, count: int, is_line: bool = False) -> list[float]:
    found = _numbers(content, name, count, is_line)
    if found is None:
        raise InputError(f"{content.path}: {name} needs {count} numbers: correct it")
    return found


def _caltech(content: Content, size: ImageSize | None) -> CalibrationFile:
    path = content.path
    nx, ny = _numbers(content, "nx", 1, True), _numbers(content, "ny", 1, True)
    notes: tuple[str, ...] = ()
    if nx is not None and ny is not None:
        sides: tuple[float, float] = (nx[0], ny[0])
    else:
        sides, note = size_of_images(path, size)
        notes = (note,)
    if re.search(r"(?m)^\s*fc_left\s*=", content.words) is None:
        return CalibrationFile(path, [_of_toolbox(content, "", path.stem, sides, notes)])
    left = _of_toolbox(content, "_left", "left", sides, notes)
    right = _of_toolbox(content, "_right", "right", sides, ())
    turn, shift = _required(content, "om", 3, True), _required(content, "T", 3, True)
    right_from_left = pose_of_rotvec(path, "om", [*turn, *shift])
    right_from_left = Pose(right_from_left.rotation, METRES_PER_MILLIMETRE * right_from_left.translation)
    return pair(content, left, right, right_from_left.inverse())


def _of_toolbox(content: Content, suffix: str, name: str, sides: tuple[float, float], notes: tuple[str, ...]) -> Placed:
    fx, fy = _required(content, f"fc{suffix}", 2, True)
    cx, cy = _required(content, f"cc{suffix}", 2, True)
    skew = (_numbers(content, f"alpha_c{suffix}", 1, True) or [0.0])[0]
    if abs(skew) > MAX_SKEW:
        raise InputError(f"{content.path}: alpha_c{suffix} is {skew:g}, which no sensor has: correct it")
    notes += (
        (f"{content.path}: the skew alpha_c{suffix} ({skew:g}) is skipped, as cameras here have none",) if skew else ()
    )
    kc = _numbers(content, f"kc{suffix}", 5, True) or _numbers(content, f"kc{suffix}", 4, True) or []
    return lens_camera(content, name, sides, [fx, fy, cx, cy], kc, "opencv", None, notes, f"fc{suffix}")


DIALECT = Dialect(
    "matlab",
    "MATLAB, Caltech's calibration toolbox",
    "`Calib_Results.m`, printed `cameraParams`",
    "text",
    "fc = and cc =; FocalLength and PrincipalPoint, or IntrinsicMatrix",
    _recognises,
    _read,
)
