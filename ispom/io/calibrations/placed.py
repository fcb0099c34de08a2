"""A camera and where it sits, between the formats; and the pieces that several formats share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.camera import usable
from ispom.io.mapping import finite_numbers
from ispom.types import Camera
from ispom.types.camera import Lens

ORTHOGONAL = 1e-3
"""By so much a rotation in a file may not be one: files round."""
EXACT = 1e-12
"""Rotations nearer than this to one are taken as they stand."""


@dataclass(frozen=True, eq=False)
class Placed:
    """One camera of a rig."""

    name: str
    camera: Camera
    body_from_camera: Pose


def camera_from(
    path: Path, where: str, size: Array, intrinsics: list[float], distortion: list[float], lens: str
) -> Camera:
    """The camera of a file's numbers; InputError says what is impossible about it."""
    width, height = (float(side) for side in size)
    if not (width > 0 and height > 0 and width == int(width) and height == int(height)):
        raise InputError(f"{path}: the size of {where} is not in whole pixels: correct it")
    if not any(distortion) and lens == "opencv":
        distortion = []
    kind: Lens = "fisheye" if lens == "fisheye" else "opencv"
    camera = Camera(int(width), int(height), *intrinsics, distortion=tuple(distortion), lens=kind)
    return usable(camera, f"{path}: {where}")


def matrix_of(pose: Pose) -> list[list[float]]:
    """(4, 4) as nested lists."""
    return pose.matrix.tolist()


def pose_of(path: Path, where: str, value: Any) -> Pose:
    """Of a (4, 4) matrix as nested or flat lists; InputError where it is no rigid motion."""
    flat = value
    if isinstance(value, list) and len(value) == 4 and all(isinstance(row, list) for row in value):
        flat = [number for row in value for number in row]
    matrix = np.array(finite_numbers(path, where, flat, 16)).reshape(4, 4)
    rotation = matrix[:3, :3]
    off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if off > ORTHOGONAL or np.linalg.det(rotation) < 0 or np.abs(matrix[3] - (0, 0, 0, 1)).max() > ORTHOGONAL:
        raise InputError(f"{path}: {where} is no rigid motion: correct it")
    if off > EXACT:
        u, _, vt = np.linalg.svd(rotation)
        rotation = u @ vt
    return Pose(rotation, matrix[:3, 3])


def distortion_name(camera: Camera, names: dict[str, str], program: str, most: int) -> str:
    """The format's name of the lens; InputError where it has none that holds all coefficients."""
    if any(camera.distortion[most:]):
        raise InputError(
            f"{program} has no lens with {len(camera.distortion)} coefficients: calibrate with --model radtan, "
            "or choose --format opencv, ros or colmap"
        )
    return names[camera.lens]


class _Flow(yaml.SafeDumper):
    """Lists of numbers on one line, numbers with all their digits."""


def flow() -> type[yaml.SafeDumper]:
    return _Flow


_Flow.add_representer(float, lambda dumper, value: dumper.represent_scalar("tag:yaml.org,2002:float", _float(value)))
_Flow.add_representer(
    list, lambda dumper, value: dumper.represent_sequence("tag:yaml.org,2002:seq", value, flow_style=_is_flat(value))
)
_Flow.ignore_aliases = lambda self, data: True  # type: ignore[method-assign]


def _is_flat(value: list[Any]) -> bool:
    return not any(isinstance(each, list | dict) for each in value)


def _float(value: float) -> str:
    """YAML 1.1 wants a point in a number with an exponent."""
    text = repr(float(value))
    if "e" in text and "." not in text:
        text = text.replace("e", ".0e")
    return text
