"""A dialect as a value: one program's format of calibrations, how it is recognised, and how it is read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.placed import Placed, camera_from, placed, rotation_of
from ispom.io.camera import coefficients
from ispom.io.mapping import finite_numbers
from ispom.types import Rig

Kind = Literal["YAML", "JSON", "XML", "text", "binary"]
NOMINAL_RATE = "nominal_rate_hz"
"""Entry for a camera's stated frame rate, which is used only where the images have no times."""
CORNER_ORIGIN_PX = 0.5
"""Coordinates of the top-left pixel's centre, which is (0, 0) here, in programs with (0, 0) at that pixel's corner."""


@dataclass(frozen=True, eq=False)
class CalibrationFile:
    """The content of one file."""

    path: Path
    cameras: list[Placed]
    rig: Rig | None = None
    """The content of a rig.yaml."""
    second: Pose | None = None
    """first_from_second of a pair, where the file has nothing else."""
    is_relative: bool = False
    """Whether poses are those of one camera in another, not on a body that the file defines."""
    of_pair: bool = False
    """Whether poses are valid for a left and a right camera only: ROS's camera_info has any other at 0."""
    entries: dict[Any, Any] = field(default_factory=dict)
    """All entries, also those that do not describe the camera, such as the rate of its images; empty for several
    cameras."""
    usual: str = ""
    """Name of the camera to use where one is needed; "" where the file does not define it."""


@dataclass(frozen=True, eq=False)
class Dialect:
    """How the files of a program are recognised and read. Its conventions are in the docstring of its module."""

    name: str
    """Small letters, digits and _."""
    title: str
    """Usual name of the program."""
    files: str
    """Usual names of the files."""
    kind: Kind
    looked_for: str
    """Description of the dialect's signature in a file."""
    recognises: Callable[[Content], bool]
    """Checks for the signature. Must be true for this dialect's files only, unless it has an `order`."""
    read: Callable[[Content, ImageSize | None], CalibrationFile]
    """Reads a file; the size is that of the images, used where the file has none. Raises InputError that names what is
    missing, wrong or not supported."""
    order: int = 0
    """Position among the dialects whose signature other programs' files may have, too: these are tried in this order
    where no other dialect recognises a file."""


def size_of_images(path: Path, size: ImageSize | None) -> tuple[tuple[int, int], str]:
    """Returns width and height of the images, for a file that has none, and a note about that. Raises InputError where
    they are not known."""
    if size is None:
        raise InputError(f"{path} has no image size: add it with --image-size WIDTHxHEIGHT, or give the images with it")
    width, height = size()
    return (width, height), f"{path}: it has no image size: that of the images, {width} x {height}, is used"


def lens_camera(
    content: Content,
    name: str,
    size: tuple[float, float],
    intrinsics: list[float],
    distortion: list[float],
    lens: str,
    pose: Pose | None = None,
    notes: tuple[str, ...] = (),
    where: str = "",
    origin: float = 0.0,
) -> Placed:
    """Returns the camera of a file's values: fx, fy, cx, cy, and the coefficients in OpenCV's order, any number of
    them. `where` is its place in the file, `origin` the coordinates of the centre of the top-left pixel there."""
    place = where or "the camera"
    fx, fy, cx, cy = intrinsics
    values = coefficients(content.path, f"the distortion of {place}", list(distortion), lens)
    camera = camera_from(content.path, place, np.array(size), [fx, fy, cx - origin, cy - origin], values, lens)
    return placed(content.path, where, name, camera, pose, notes)


def not_supported(path: Path, program: str, what: str, cure: str = "") -> InputError:
    """Returns the error for a recognised file whose lens no camera model supports."""
    cure = cure or "calibrate with OpenCV's distortion, or its fisheye lens (equidistant, Kannala-Brandt)"
    return InputError(f"{path}: a file of {program}: {what} is not supported: {cure}")


def one_number(path: Path, where: str, values: Mapping[Any, Any], key: str, default: float | None = None) -> float:
    """Returns a finite number of a mapping. Raises InputError that names the missing or invalid one."""
    value = values.get(key, default)
    return finite_numbers(path, f"{where}{key}", [value], 1)[0]


def several_numbers(
    path: Path, where: str, values: Mapping[Any, Any], keys: tuple[str, ...], default: float | None = None
) -> list[float]:
    """Returns the finite numbers with these names. Raises InputError as `one_number`."""
    return [one_number(path, where, values, key, default) for key in keys]


def mapping_in(path: Path, where: str, values: Any) -> dict[Any, Any]:
    """Returns an inner mapping. Raises InputError for a value that is none."""
    if not isinstance(values, dict):
        raise InputError(f"{path}: {where} must hold named values: correct it")
    return values


def list_in(path: Path, where: str, values: Any, most: int = 64) -> list[Any]:
    """Returns an inner list that is not empty. Raises InputError where it is none, or has more than `most`."""
    if not isinstance(values, list) or not values or len(values) > most:
        raise InputError(f"{path}: {where} must be a list of 1 to {most} entries: correct it")
    return values


def rigid(path: Path, where: str, matrix: Array) -> Pose:
    """Returns the pose of a (3, 4) matrix, or of one of (4, 4) whose last row is 0 0 0 1. Raises InputError."""
    if matrix.shape == (4, 4) and np.abs(matrix[3] - (0, 0, 0, 1)).max() > 1e-6:
        raise InputError(f"{path}: the last row of {where} is not 0 0 0 1: correct it")
    return Pose(rotation_of(path, where, matrix[:3, :3]), matrix[:3, 3].copy())


def rigid_of_values(path: Path, where: str, entry: Any) -> Pose:
    """Returns the pose of 12 or 16 numbers, flat, in rows, or in OpenCV's `data`. Raises InputError."""
    flat = entry.get("data") if isinstance(entry, dict) else entry
    if isinstance(flat, list) and flat and all(isinstance(row, list) for row in flat):
        flat = [value for row in flat for value in row]
    numbers = np.array(finite_numbers(path, where, flat, (12, 16)))
    return rigid(path, where, numbers.reshape(-1, 4))


def pose_of_rotvec(path: Path, where: str, values: list[float]) -> Pose:
    """Returns the pose of a rotation vector [rad] and a translation, six numbers. Raises InputError for more than a
    few turns."""
    rotvec, translation = np.array(values[:3]), np.array(values[3:])
    if np.linalg.norm(rotvec) > 20:
        raise InputError(f"{path}: {where} turns by more than three turns: it must be in radians, correct it")
    return Pose.from_rotvec(rotvec, translation)


def pose_of_quaternion(path: Path, where: str, xyzw: list[float], translation: list[float]) -> Pose:
    """Raises InputError for a quaternion that is not of length 1 (to 1 %)."""
    if abs(np.linalg.norm(xyzw) - 1) > 0.01:
        raise InputError(f"{path}: the quaternion of {where} is not of length 1: correct it")
    return Pose.from_xyzw(np.array(xyzw), np.array(translation))


def pair(content: Content, left: Placed, right: Placed, left_from_right: Pose, **more: Any) -> CalibrationFile:
    """Returns the file of a left and a right camera."""
    cameras = [left.at(Pose()), right.at(left_from_right)]
    return CalibrationFile(content.path, cameras, is_relative=True, **more)
