"""ROS's camera_info YAML of one camera, as camera_calibration writes it; it has no pose but a rectified pair's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.calibrations.placed import Placed, camera_from, flow
from ispom.io.mapping import finite_numbers, read_mapping
from ispom.types import Camera

MODELS = {"plumb_bob": "opencv", "rational_polynomial": "opencv", "equidistant": "fisheye"}


def ros_text(each: Placed) -> str:
    """Of the camera itself: rectification is the identity, and its projection that of the camera."""
    camera = each.camera
    projection = np.hstack([camera.matrix, np.zeros((3, 1))])
    model, count = "plumb_bob", 5
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
        "rectification_matrix": _matrix(np.eye(3)),
        "projection_matrix": _matrix(projection),
    }
    return yaml.dump(content, Dumper=flow(), sort_keys=False, width=200)


def read_ros(path: Path) -> Camera:
    """The camera as it is, before rectification; InputError names the entry that is missing or wrong."""
    content = read_mapping(path)
    lens = MODELS.get(str(content.get("distortion_model", "plumb_bob")))
    if lens is None:
        raise InputError(f"{path}: distortion_model is {content['distortion_model']}: give one of {', '.join(MODELS)}")
    size = finite_numbers(path, "image_width", [content.get("image_width"), content.get("image_height")], 2)
    matrix = np.array(_data(path, content, "camera_matrix", (9,))).reshape(3, 3)
    distortion = _data(path, content, "distortion_coefficients", (0, 4, 5, 8))
    if len(distortion) == 5 and distortion[4] == 0 and lens == "opencv":
        distortion = distortion[:4]
    intrinsics = [float(matrix[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2))]
    return camera_from(path, "camera_matrix", np.array(size), intrinsics, distortion, lens)


def _data(path: Path, content: dict[Any, Any], key: str, counts: tuple[int, ...]) -> list[float]:
    entry = content.get(key)
    if not isinstance(entry, dict):
        raise InputError(f"{path}: {key} is missing: add it")
    return finite_numbers(path, f"{key}.data", entry.get("data"), counts)


def _matrix(values: Array) -> dict[str, Any]:
    return {"rows": values.shape[0], "cols": values.shape[1], "data": np.ravel(values).tolist()}
