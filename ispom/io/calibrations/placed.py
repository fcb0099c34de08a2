"""Rotation matrices in files, which are rounded there and made orthonormal here; cameras with poses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ispom.cameras import require_opencv
from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.camera import usable
from ispom.io.mapping import finite_numbers
from ispom.plausibility.cameras import camera_doubts
from ispom.types import Camera

MAX_ROUNDING = 1e-3
"""Largest deviation of R R^T from the identity that is accepted as rounding, for any number of digits."""
NO_ROUNDING = 1e-12
"""Deviation of R R^T from the identity below which a matrix is used unchanged."""
_ERROR_PER_DIGIT = 2.0
"""Accepted deviation of R R^T, in units of the last digit: rounding by half a digit causes up to sqrt(3)."""


def rotation_of(path: Path, where: str, matrix: Array) -> Array:
    """Returns the rotation (3, 3) nearest to a matrix (3, 3). Raises InputError where rounding does not explain the
    difference."""
    away = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
    if away > max(MAX_ROUNDING, _ERROR_PER_DIGIT * 10.0 ** -_decimals(matrix)) or np.linalg.det(matrix) <= 0:
        raise InputError(f"{path}: {where} is no rotation (its rows are not of length 1 at right angles): correct it")
    if away <= NO_ROUNDING:
        return matrix
    u, _, vt = np.linalg.svd(matrix)
    return u @ vt


def _decimals(matrix: Array) -> int:
    """Returns the digits after the point of the value with most of them; at least 2."""
    words = [np.format_float_positional(value, trim="-") for value in np.ravel(matrix)]
    return max(2, *(len(word.partition(".")[2]) for word in words))


# A camera with its pose, which all formats have in common; and functions that several formats share.


LAST_ROW_TOLERANCE = 1e-6
"""Largest deviation of the last row of a rigid motion from 0 0 0 1."""


@dataclass(frozen=True, eq=False)
class Placed:
    """One camera of a rig."""

    name: str
    camera: Camera
    body_from_camera: Pose | None
    """None where its file has no pose."""
    notes: tuple[str, ...] = ()
    """Sentences about skipped entries of the file, and about likely mistakes in it."""

    @property
    def pose(self) -> Pose:
        """Returns body_from_camera. Raises ValueError where it is unknown."""
        if self.body_from_camera is None:
            raise ValueError(f"the pose of {self.name} is not known")
        return self.body_from_camera

    def at(self, body_from_camera: Pose | None) -> Placed:
        return replace(self, body_from_camera=body_from_camera)


def placed(
    path: Path,
    where: str,
    name: str,
    camera: Camera,
    body_from_camera: Pose | None,
    notes: tuple[str, ...] = (),
) -> Placed:
    """Returns a camera of a file's entry `where`, with notes about likely mistakes in it."""
    return Placed(name, camera, body_from_camera, (*notes, *camera_doubts(camera, f"{path}: {where}".rstrip(": "))))


def camera_from(
    path: Path, where: str, size: Array, intrinsics: list[float], distortion: list[float], lens: str
) -> Camera:
    """Returns the camera of a file's values. Raises InputError for an impossible one."""
    width, height = (float(side) for side in size)
    if not (width > 0 and height > 0 and width == int(width) and height == int(height)):
        raise InputError(f"{path}: the size of {where} is not in whole pixels: correct it")
    if lens == "opencv":
        used = len(np.trim_zeros(distortion, "b"))
        distortion = [*distortion, *(0.0,) * 8][: next(count for count in (0, 4, 5, 8) if count >= used)]
    camera = Camera(int(width), int(height), *intrinsics, distortion=tuple(distortion), lens=lens)
    return usable(camera, f"{path}: {where}")


def matrix_of(pose: Pose) -> list[list[float]]:
    """Returns the matrix (4, 4) as nested lists."""
    return pose.matrix.tolist()


def pose_of(path: Path, where: str, value: Any) -> Pose:
    """Reads a (4, 4) matrix from nested or flat lists. Raises InputError where it is no rigid motion."""
    flat = value
    if isinstance(value, list) and len(value) == 4 and all(isinstance(row, list) for row in value):
        flat = [number for row in value for number in row]
    matrix = np.array(finite_numbers(path, where, flat, 16)).reshape(4, 4)
    if np.abs(matrix[3] - (0, 0, 0, 1)).max() > LAST_ROW_TOLERANCE:
        turned = not matrix[:3, 3].any()
        cure = "it is transposed: exchange its rows and columns" if turned else "correct it"
        raise InputError(f"{path}: the last row of {where} is not 0 0 0 1: {cure}")
    return Pose(rotation_of(path, where, matrix[:3, :3]), matrix[:3, 3])


def distortion_name(camera: Camera, names: dict[str, str], program: str, most: int) -> str:
    """Returns the format's name of the lens. Raises InputError where it has none that holds all coefficients."""
    require_opencv(camera, program)
    if any(camera.distortion[most:]):
        raise InputError(
            f"{program} has no lens with {len(camera.distortion)} coefficients: calibrate with --model radtan, "
            "or choose --format opencv, ros or colmap"
        )
    return names[camera.lens]


class FlowDumper(yaml.SafeDumper):
    """Lists of numbers on one line, numbers with all their digits."""


FlowDumper.add_representer(
    float, lambda dumper, value: dumper.represent_scalar("tag:yaml.org,2002:float", _float(value))
)
FlowDumper.add_representer(
    list, lambda dumper, value: dumper.represent_sequence("tag:yaml.org,2002:seq", value, flow_style=_is_flat(value))
)
FlowDumper.ignore_aliases = lambda self, data: True  # type: ignore[method-assign]


def _is_flat(value: list[Any]) -> bool:
    return not any(isinstance(each, list | dict) for each in value)


def _float(value: float) -> str:
    """Returns a number with a decimal point, which YAML 1.1 requires before an exponent."""
    text = repr(float(value))
    if "e" in text and "." not in text:
        text = text.replace("e", ".0e")
    return text
