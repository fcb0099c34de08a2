"""OpenCV's files (cv2.FileStorage, in YAML, XML and JSON): camera matrices and coefficients, and the pose of the second
camera. ROS's camera_info files are of this kind, too.

This module writes camera_matrix and distortion_coefficients for one camera (as OpenCV's calibration sample does), and
K1, D1, K2, D2, R, T for a pair; further cameras are K3, D3, R3, T3. It reads these, and the other names in samples and
tutorials; R and T may be in a separate file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ispom.cameras import require_opencv
from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.calibrations.camera_info import ImageSize, camera_info, matrix_key, values
from ispom.io.calibrations.placed import Placed, placed, rotation_of
from ispom.io.mapping import MAX_BYTES, MAX_DEPTH, read_mapping
from ispom.io.rows import read_text
from ispom.types import Camera

MAX_CAMERAS = 8
"""Largest number of cameras of a file."""
XML_HEAD = "<opencv_storage"


def opencv_text(cameras: list[Placed]) -> str:
    """Writes the cameras; the first one is the reference of the others: x_n = R x_1 + T."""
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
            pose = each.pose.inverse() @ cameras[0].pose
            suffix = "" if n == 2 else str(n)
            lines += [_matrix(f"R{suffix}", pose.rotation), _matrix(f"T{suffix}", pose.translation[:, None])]
    return "\n".join(lines) + "\n"


def read_opencv(path: Path, size: ImageSize | None = None, content: dict[Any, Any] | None = None) -> list[Placed]:
    """Reads the cameras; the first one is the body. Cameras without a pose in the file have none.

    The pose of a single camera is that in the rectified left camera of its pair, where the file has it. `content` are
    the file's entries, if they were read before. `size` is that of the images, used where the file has none. Raises
    InputError that names the missing or invalid entry.
    """
    content = storage(path) if content is None else content
    if (key := matrix_key(content)) is not None:
        info = camera_info(path, content, size=size)
        name = str(content.get("camera_name", content.get("name", path.stem)))
        return [placed(path, key, name, info.raw, info.pair_from_camera, info.notes)]
    numbers = [n for n in map(str, range(1, MAX_CAMERAS + 1)) if matrix_key(content, n) is not None]
    if not numbers:
        raise InputError(f"{path} holds no camera_matrix and no K1 or M1: give a calibration of OpenCV")
    out: list[Placed] = []
    for n in numbers:
        info = camera_info(path, content, n, size=size)
        pose = _pose(path, content, "" if n == "2" else n) if out else Pose()
        name = str(content.get(f"name{n}", f"cam{len(out)}"))
        out.append(placed(path, matrix_key(content, n) or n, name, info.raw, pose, info.notes))
    return out


def read_extrinsics(path: Path, content: dict[Any, Any] | None = None) -> Pose | None:
    """Reads first_from_second of a pair, from a file with only R and T, as OpenCV's sample writes it; None for other
    files."""
    content = storage(path) if content is None else content
    only_pose = matrix_key(content) is None and matrix_key(content, "1") is None
    return _pose(path, content, "") if only_pose else None


def storage(path: Path) -> dict[Any, Any]:
    """Returns the entries of a file of OpenCV (YAML, XML or JSON). Raises InputError for another file."""
    text = read_text(path, MAX_BYTES)
    return _of_xml(path, text) if is_xml(text) else read_mapping(path)


def is_xml(text: str) -> bool:
    """Returns whether it is OpenCV's XML."""
    return XML_HEAD in text[:1000]


def _pose(path: Path, content: dict[Any, Any], suffix: str) -> Pose | None:
    """Returns first_from_camera; None where the file has no pose."""
    r, t = f"R{suffix}", f"T{suffix}"
    if r not in content or t not in content:
        return None
    rotation = rotation_of(path, r, values(path, r, content[r], 9).reshape(3, 3))
    return Pose(rotation, values(path, t, content[t], 3)).inverse()


def _interior(camera: Camera, matrix: str, distortion: str, n: str = "") -> list[str]:
    require_opencv(camera, "OpenCV")
    coefficients = np.array(camera.distortion or (0.0,) * 4)[:, None]
    named = [f"distortion_model{n}: fisheye"] if camera.lens == "fisheye" else []
    return [_matrix(matrix, camera.matrix), _matrix(distortion, coefficients), *named]


def _matrix(name: str, array: Array) -> str:
    data = ", ".join(repr(float(v)) for v in np.ravel(array))
    return f"{name}: !!opencv-matrix\n   rows: {len(array)}\n   cols: {array.shape[1]}\n   dt: d\n   data: [ {data} ]"


def _of_xml(path: Path, text: str) -> dict[Any, Any]:
    wrong = InputError(f"{path} is not an XML file of OpenCV: restore it, or save it as YAML")
    if "<!" in text.replace("<!--", ""):  # nested entities can expand to billions of letters
        raise wrong
    try:
        root = ElementTree.fromstring(text.encode())
    except (ElementTree.ParseError, ValueError, LookupError):
        raise wrong from None
    return {element.tag: _of_element(element, wrong) for element in root}


def _of_element(element: ElementTree.Element, wrong: InputError, depth: int = 0) -> Any:
    if depth > MAX_DEPTH:
        raise wrong
    inner = list(element)
    if not inner:
        words = [_number(word) for word in (element.text or "").split()]
        return words[0] if len(words) == 1 else words
    if all(each.tag == "_" for each in inner):
        return [_of_element(each, wrong, depth + 1) for each in inner]
    children = {each.tag: _of_element(each, wrong, depth + 1) for each in inner}
    if not isinstance(children.get("data", []), list):
        children["data"] = [children["data"]]
    return children


def _number(word: str) -> float | str:
    try:
        return float(word)
    except ValueError:
        return word.strip('"')
