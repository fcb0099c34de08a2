"""A camera and where it sits, between the formats; and the pieces that several formats share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ispom.cameras import require_opencv
from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.camera import doubts, usable
from ispom.io.mapping import finite_numbers
from ispom.io.rotations import rotation_of
from ispom.types import Camera

HOMOGENEOUS = 1e-6
"""The last row of a rigid motion is 0 0 0 1, to this."""


@dataclass(frozen=True, eq=False)
class Placed:
    """One camera of a rig."""

    name: str
    camera: Camera
    body_from_camera: Pose | None
    """None where its file does not say where it sits."""
    notes: tuple[str, ...] = ()
    """Sentences about what of the file is skipped, and what in it is likely a mistake."""

    @property
    def pose(self) -> Pose:
        """The same, of a camera whose place is known."""
        assert self.body_from_camera is not None
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
    """A camera that was found in a file under `where`, with notes about what in it is likely a mistake."""
    return Placed(name, camera, body_from_camera, (*notes, *doubts(camera, f"{path}: {where}".rstrip(": "))))


def camera_from(
    path: Path, where: str, size: Array, intrinsics: list[float], distortion: list[float], lens: str
) -> Camera:
    """The camera of a file's numbers; InputError says what is impossible about it."""
    width, height = (float(side) for side in size)
    if not (width > 0 and height > 0 and width == int(width) and height == int(height)):
        raise InputError(f"{path}: the size of {where} is not in whole pixels: correct it")
    if lens == "opencv":
        used = len(np.trim_zeros(distortion, "b"))
        distortion = [*distortion, *(0.0,) * 8][: next(count for count in (0, 4, 5, 8) if count >= used)]
    camera = Camera(int(width), int(height), *intrinsics, distortion=tuple(distortion), lens=lens)
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
    if np.abs(matrix[3] - (0, 0, 0, 1)).max() > HOMOGENEOUS:
        turned = not matrix[:3, 3].any()
        cure = "it is transposed: exchange its rows and columns" if turned else "correct it"
        raise InputError(f"{path}: the last row of {where} is not 0 0 0 1: {cure}")
    return Pose(rotation_of(path, where, matrix[:3, :3]), matrix[:3, 3])


def distortion_name(camera: Camera, names: dict[str, str], program: str, most: int) -> str:
    """The format's name of the lens; InputError where it has none that holds all coefficients."""
    require_opencv(camera, program)
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
