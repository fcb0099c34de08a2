"""OpenCV's YAML files (cv2.FileStorage): camera matrices and coefficients, and the pose of the second camera.

Written are camera_matrix and distortion_coefficients for one camera (as OpenCV's calibration sample does), and
K1, D1, K2, D2, R, T for a pair; further cameras are K3, D3, R3, T3. Read are these, and M1, M2 for K1, K2.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.calibrations.placed import Placed, camera_from
from ispom.io.files import read_bytes
from ispom.io.mapping import MAX_BYTES, finite_numbers, parse_yaml, read_mapping
from ispom.types import Camera

_COUNTS = (0, 4, 5, 8, 12, 14)


def opencv_text(cameras: list[Placed]) -> str:
    """x_n = R x_1 + T: the first camera is the world of the others."""
    lines = ["%YAML:1.0", "---", f"image_width: {cameras[0].camera.width}", f"image_height: {cameras[0].camera.height}"]
    if len(cameras) == 1:
        return "\n".join([*lines, *_interior(cameras[0].camera, "camera_matrix", "distortion_coefficients")]) + "\n"
    for n, each in enumerate(cameras, 1):
        lines += [
            f"name{n}: {each.name}",
            f"image_width{n}: {each.camera.width}",
            f"image_height{n}: {each.camera.height}",
        ]
        lines += _interior(each.camera, f"K{n}", f"D{n}", str(n))
        if n > 1:
            pose = each.body_from_camera.inverse() @ cameras[0].body_from_camera
            suffix = "" if n == 2 else str(n)
            lines += [_matrix(f"R{suffix}", pose.rotation), _matrix(f"T{suffix}", pose.translation[:, None])]
    return "\n".join(lines) + "\n"


def read_opencv(path: Path, size: tuple[int, int] | None = None) -> list[Placed]:
    """The cameras, the first one being the body. `size` (width, height) counts where the file has none.

    InputError names the entry that is missing or wrong.
    """
    content = _read(path)
    if "camera_matrix" in content:
        keys = [("camera_matrix", "distortion_coefficients", "")]
    else:
        keys = [(f"{k}{n}", f"D{n}", str(n)) for n in range(1, 9) for k in "KM" if f"{k}{n}" in content]
    if not keys:
        raise InputError(f"{path} holds no camera_matrix and no K1 or M1: give a calibration of OpenCV")
    out: list[Placed] = []
    for matrix_key, distortion_key, n in keys:
        matrix = _values(path, matrix_key, content.get(matrix_key), (9,)).reshape(3, 3)
        distortion = _values(path, distortion_key, content.get(distortion_key), _COUNTS).tolist()
        if any(distortion[8:]):
            raise InputError(
                f"{path}: {distortion_key} has a thin prism or tilted sensor: calibrate with 8 coefficients"
            )
        if not any(distortion[4:]):
            distortion = distortion[:4]
        sides = [content.get(f"image_{side}{n}", content.get(f"image_{side}")) for side in ("width", "height")]
        if None in sides and size is None:
            raise InputError(f"{path}: image_width and image_height are missing: add them")
        where = finite_numbers(path, "image_width, image_height", sides, 2) if None not in sides else list(size or ())
        intrinsics = [float(matrix[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2))]
        lens = (
            "fisheye" if content.get(f"distortion_model{n}", content.get("distortion_model")) == "fisheye" else "opencv"
        )
        camera = camera_from(path, matrix_key, np.array(where), intrinsics, distortion[:8], lens)
        out.append(Placed(str(content.get(f"name{n}", f"cam{len(out)}")), camera, _pose(path, content, len(out) + 1)))
    return out


def _pose(path: Path, content: dict[Any, Any], n: int) -> Pose:
    """body_from_camera of camera n, from 1 on."""
    suffix = "" if n == 2 else str(n)
    if n == 1 or f"R{suffix}" not in content:
        return Pose()
    rotation = _values(path, f"R{suffix}", content[f"R{suffix}"], (9,)).reshape(3, 3)
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6:
        raise InputError(f"{path}: R{suffix} is no rotation: correct it")
    return Pose(rotation, _values(path, f"T{suffix}", content.get(f"T{suffix}"), (3,))).inverse()


def _interior(camera: Camera, matrix: str, distortion: str, n: str = "") -> list[str]:
    coefficients = np.array(camera.distortion or (0.0,) * 4)[:, None]
    named = [f"distortion_model{n}: fisheye"] if camera.lens == "fisheye" else []
    return [_matrix(matrix, camera.matrix), _matrix(distortion, coefficients), *named]


def _matrix(name: str, values: Array) -> str:
    data = ", ".join(repr(float(v)) for v in np.ravel(values))
    return f"{name}: !!opencv-matrix\n   rows: {len(values)}\n   cols: {values.shape[1]}\n   dt: d\n   data: [ {data} ]"


def _read(path: Path) -> dict[Any, Any]:
    """OpenCV's own tag is none that YAML knows: it is taken for a mapping."""
    text = read_bytes(path, MAX_BYTES).decode(errors="replace")
    if "!!opencv-matrix" not in text:
        return read_mapping(path)
    body = text.replace("!!opencv-matrix", "")
    body = body.split("\n", 1)[1] if body.startswith("%YAML") else body
    content = parse_yaml(path, body)
    if not isinstance(content, dict):
        raise InputError(f"{path} is not a YAML file of OpenCV: restore it")
    return content


def _values(path: Path, where: str, entry: Any, counts: tuple[int, ...]) -> Array:
    data = entry.get("data") if isinstance(entry, dict) else entry
    if isinstance(data, list):  # OpenCV writes whole numbers as `0.`, and counts of zeros as text elsewhere
        data = [float(v) if isinstance(v, str) and v.replace(".", "").lstrip("-").isdigit() else v for v in data]
    return np.array(finite_numbers(path, where, data, counts))
