"""ROS's camera_info YAML of one camera, as camera_calibration writes it: R and P of a pair say where the two sit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ispom.cameras import require_opencv
from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.calibrations.opencv import read_opencv
from ispom.io.calibrations.placed import Placed, flow
from ispom.io.calibrations.rectified import rectified
from ispom.types import Camera


def ros_texts(cameras: list[Placed]) -> dict[str, str]:
    """One for each camera by its name. Left and right are rectified as a pair, so that P has their baseline; others
    are not: their rectification is the identity, and their projection that of the camera itself."""
    found = {each.name: ros_text(each) for each in cameras}
    by_name = {each.name: each for each in cameras}
    if {"left", "right"} <= set(by_name):
        left, right = by_name["left"], by_name["right"]
        try:
            turns = rectified(left.camera, right.camera, right.pose.inverse() @ left.pose)
        except ValueError as fault:
            raise InputError(f"ROS has no pair of these cameras ({fault}): choose --format kalibr or opencv") from None
        found |= {"left": _text(left, turns[0], turns[2]), "right": _text(right, turns[1], turns[3])}
    return found


def ros_text(each: Placed) -> str:
    """Of the camera itself, which is not of a pair."""
    return _text(each, np.eye(3), np.hstack([each.camera.matrix, np.zeros((3, 1))]))


def read_ros(path: Path) -> Camera:
    """The camera as it is, before rectification; InputError names the entry that is missing or wrong."""
    return read_opencv(path)[0].camera


def _text(each: Placed, rectification: Array, projection: Array) -> str:
    camera = each.camera
    require_opencv(camera, "ROS")
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
        "rectification_matrix": _matrix(rectification),
        "projection_matrix": _matrix(projection),
    }
    return yaml.dump(content, Dumper=flow(), sort_keys=False, width=200)


def _matrix(values: Array) -> dict[str, Any]:
    return {"rows": values.shape[0], "cols": values.shape[1], "data": np.ravel(values).tolist()}
