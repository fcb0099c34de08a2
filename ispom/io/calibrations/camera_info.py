"""The entries of a camera_info, in ROS's messages and in the YAML of ROS and OpenCV: K, D, R, P and the sizes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ispom.cameras import require_opencv
from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.calibrations.pair import rectified
from ispom.io.calibrations.placed import FlowDumper, Placed, camera_from, rotation_of
from ispom.io.camera import coefficients, intrinsics_of, lens_of
from ispom.io.mapping import finite_numbers
from ispom.types import Camera

MATRICES = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "camera_matrix_", "intrinsic_matrix", "mtx", "K", "M")
"""Names of a camera matrix in OpenCV's samples, tutorials and ROS; those in a pair's file end in 1 or 2."""
_MESSAGE = ("k",)
"""Name in ROS 2's messages; with a number at its end it is a distortion coefficient."""
_DISTORTIONS = ("distortion_coefficients", "Distortion_Coefficients", "distortion_coeffs", "distCoeffs", "dist_coeffs")
_DISTORTIONS = (*_DISTORTIONS, "distCoeff", "dist_coeff", "dist", "D", "d")
_WIDTHS, _HEIGHTS = ("image_width", "image_Width", "width"), ("image_height", "image_Height", "height")
_SIZES = ("image_size", "imageSize", "img_size", "resolution")
_ROTATIONS, _PROJECTIONS = ("rectification_matrix", "R", "r"), ("projection_matrix", "P", "p")


ImageSize = Callable[[], tuple[int, int]]
"""Returns (width, height) of the images of a calibration."""


@dataclass(frozen=True, eq=False)
class CameraInfo:
    """A camera, and how its images are rectified."""

    raw: Camera
    """The camera of the recorded images, which may be binned, or a part of the sensor."""
    turn: Array
    """(3, 3) rectified_from_raw."""
    projection: Array | None
    """(3, 4) projection of the rectified image; None where there is none."""
    notes: tuple[str, ...] = ()

    @property
    def pair_from_camera(self) -> Pose | None:
        """Returns the pose in the rectified left camera of its pair, from P, which contains -fx times the baseline;
        None for a camera that is not rectified."""
        p = self.projection
        if p is None:
            return None
        return Pose(self.turn, np.array([-p[0, 3] / p[0, 0], -p[1, 3] / p[1, 1], 0.0]))


def matrix_key(content: Mapping[Any, Any], n: str = "") -> str | None:
    """Returns the name that camera n's matrix has in a file; None where it has none."""
    return _key(content, MATRICES if n else (*MATRICES, *_MESSAGE), n)


def camera_info(
    path: Path, content: Mapping[Any, Any], n: str = "", where: str = "", size: ImageSize | None = None
) -> CameraInfo:
    """Reads camera n of a file's entries, or of a message with the name `where` ("/left/camera_info: ").

    `size` is that of the images, used where there is none. Raises InputError that names the missing or invalid entry.
    """
    lens = lens_of(path, content, where, n)
    key, other = matrix_key(content, n), _key(content, _DISTORTIONS, n)
    if key is None:
        raise InputError(f"{path}: {where}{MATRICES[0]} is missing: add it")
    matrix = values(path, f"{where}{key}", content[key], 9).reshape(3, 3)
    intrinsics, notes = intrinsics_of(path, f"{where}{key}", matrix)
    where_d = f"{where}{other or _DISTORTIONS[0]}"
    distortion = coefficients(path, where_d, _flat(content.get(other)), lens)
    sides, own = _size(path, where, content, n, size)
    camera = camera_from(path, f"{where}{key}", np.array(sides), intrinsics, distortion, lens)
    turn, projection = np.eye(3), None
    if not n and (entry := _key(content, _PROJECTIONS)) is not None:
        p = values(path, f"{where}{entry}", content[entry], 12).reshape(3, 4)
        projection = p if p[0, 0] > 0 and p[1, 1] > 0 else None
        r = _key(content, _ROTATIONS)
        matrix = np.eye(3) if r is None else values(path, f"{where}{r}", content[r], 9).reshape(3, 3)
        turn = rotation_of(path, f"{where}{r}", matrix) if matrix.any() else turn
    info = CameraInfo(camera, turn, projection, (*notes, *own))
    return info if n else _as_imaged(path, where, content, info)


def values(path: Path, where: str, entry: Any, count: int) -> Array:
    """Returns the `count` numbers of a matrix: OpenCV's and ROS's with rows, cols and data, or lists of numbers or
    rows."""
    return np.array(finite_numbers(path, where, _flat(entry), count))


def _flat(entry: Any) -> Any:
    data = entry.get("data") if isinstance(entry, dict) else entry
    if isinstance(data, list) and data and all(isinstance(row, list) for row in data):
        return [value for row in data for value in row]
    return data


def _key(content: Mapping[Any, Any], names: tuple[str, ...], n: str = "") -> str | None:
    return next((f"{name}{n}" for name in names if f"{name}{n}" in content), None)


def _size(
    path: Path, where: str, content: Mapping[Any, Any], n: str, size: ImageSize | None
) -> tuple[list[float], tuple[str, ...]]:
    """Returns width and height, and a note where they are not from the file."""
    for suffix in dict.fromkeys((n, "")):
        keys = [_key(content, names, suffix) for names in (_WIDTHS, _HEIGHTS)]
        if None not in keys:
            return finite_numbers(path, f"{where}{keys[0]}, {keys[1]}", [content[key] for key in keys], 2), ()
        if (key := _key(content, _SIZES, suffix)) is not None:
            return finite_numbers(path, f"{where}{key}", _flat(content[key]), 2), ()
    if size is None:
        raise InputError(f"{path}: {where}image_width and image_height are missing: add them")
    width, height = size()
    return [float(width), float(height)], (
        f"{path}: it has no image size: that of the images, {width} x {height}, is used",
    )


def _as_imaged(path: Path, where: str, content: Mapping[Any, Any], info: CameraInfo) -> CameraInfo:
    """Returns the camera of the part of the sensor that is read out, binned, as in ROS's image_geometry: its K and P
    are those of the whole sensor."""
    region = content.get("roi")
    region = region if isinstance(region, dict) else {}
    entries = [content.get("binning_x", 0), content.get("binning_y", 0)]
    entries += [region.get(key, 0) for key in ("x_offset", "y_offset", "width", "height")]
    binning = finite_numbers(path, f"{where}binning and roi", entries, 6)
    bins = [max(value, 1.0) for value in binning[:2]]
    start, sides = binning[2:4], [binning[4] or info.raw.width, binning[5] or info.raw.height]
    if bins == [1, 1] and start == [0, 0] and sides == [info.raw.width, info.raw.height]:
        return info
    if any(value != int(value) or value < 0 for value in binning):
        raise InputError(f"{path}: {where}binning and roi are not whole numbers of pixels: correct them")
    k = info.raw
    camera = replace(
        k,
        width=int(sides[0] // bins[0]),
        height=int(sides[1] // bins[1]),
        fx=k.fx / bins[0],
        fy=k.fy / bins[1],
        cx=(k.cx - start[0]) / bins[0],
        cy=(k.cy - start[1]) / bins[1],
    )
    p = info.projection
    if p is not None:
        p = p - np.array([[start[0]], [start[1]], [0.0]]) * p[2]
        p = p / np.array([[bins[0]], [bins[1]], [1.0]])
    parts = [f"binning {bins[0]:g} x {bins[1]:g}"] if bins != [1, 1] else []
    parts += ["a part of the sensor"] if len(parts) == 0 or start != [0, 0] or sides != [k.width, k.height] else []
    note = (
        f"{path}: {where}{' and '.join(parts)}: images are {camera.width} x {camera.height} of {k.width} x {k.height}"
    )
    checked = camera_from(
        path, f"{where}binning and roi", np.array([camera.width, camera.height]),
        [camera.fx, camera.fy, camera.cx, camera.cy], list(camera.distortion), camera.lens,
    )  # fmt: skip
    return CameraInfo(checked, info.turn, p, (*info.notes, note))


def ros_texts(cameras: list[Placed]) -> dict[str, str]:
    """Writes a YAML for each camera, by name.

    Left and right are rectified as a pair, so that P has their baseline. The others have the identity as rectification,
    and the projection of the camera itself. Raises InputError where the pair cannot be rectified.
    """
    texts = {each.name: ros_text(each) for each in cameras}
    by_name = {each.name: each for each in cameras}
    if {"left", "right"} <= set(by_name):
        left, right = by_name["left"], by_name["right"]
        try:
            turns = rectified(left.camera, right.camera, right.pose.inverse() @ left.pose)
        except ValueError as fault:
            raise InputError(f"ROS has no pair of these cameras ({fault}): choose --format kalibr or opencv") from None
        texts |= {"left": _text(left, turns[0], turns[2]), "right": _text(right, turns[1], turns[3])}
    return texts


def ros_text(each: Placed) -> str:
    """Writes the calibration of a single camera, not of a pair."""
    return _text(each, np.eye(3), np.hstack([each.camera.matrix, np.zeros((3, 1))]))


def _text(each: Placed, rectification: Array, projection: Array) -> str:
    camera = each.camera
    model, count = "plumb_bob", 5
    require_opencv(camera, "ROS")
    if camera.lens == "fisheye":
        model, count = "equidistant", 4
    elif len(camera.distortion) > 5:
        model, count = "rational_polynomial", 8
    content: dict[str, Any] = {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": each.name,
        "camera_matrix": _matrix(camera.matrix),
        "distortion_model": model,
        "distortion_coefficients": _matrix(np.array([[*camera.distortion, *(0.0,) * 8][:count]])),
        "rectification_matrix": _matrix(rectification),
        "projection_matrix": _matrix(projection),
    }
    return yaml.dump(content, Dumper=FlowDumper, sort_keys=False, width=200)


def _matrix(values: Array) -> dict[str, Any]:
    return {"rows": values.shape[0], "cols": values.shape[1], "data": np.ravel(values).tolist()}
