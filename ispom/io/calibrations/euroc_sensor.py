"""EuRoC's sensor.yaml of one camera: T_BS is body_from_camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ispom.errors import InputError
from ispom.io.calibrations.placed import Placed, camera_from, distortion_name, flow, placed, pose_of
from ispom.io.lens import coefficients, lens_of
from ispom.io.mapping import finite_numbers, read_mapping


def euroc_sensor_text(each: Placed, rate_hz: float | None = None) -> str:
    """InputError for a rational lens, which EuRoC's format does not have."""
    camera = each.camera
    name = distortion_name(camera, {"opencv": "radial-tangential", "fisheye": "equidistant"}, "EuRoC's sensor.yaml", 4)
    content: dict[str, Any] = {
        "sensor_type": "camera",
        "comment": each.name,
        "T_BS": {"cols": 4, "rows": 4, "data": each.pose.matrix.ravel().tolist()},
        **({} if rate_hz is None else {"rate_hz": rate_hz}),
        "resolution": [camera.width, camera.height],
        "camera_model": "pinhole",
        "intrinsics": [camera.fx, camera.fy, camera.cx, camera.cy],
        "distortion_model": name,
        "distortion_coefficients": [*camera.distortion, 0.0, 0.0, 0.0, 0.0][:4],
    }
    return "%YAML:1.0\n" + yaml.dump(content, Dumper=flow(), sort_keys=False, width=200)


def read_euroc_sensor(path: Path, name: str = "") -> Placed:
    """InputError names the entry that is missing or wrong."""
    content = read_mapping(path)
    lens = lens_of(path, content)
    size = finite_numbers(path, "resolution", content.get("resolution"), 2)
    intrinsics = finite_numbers(path, "intrinsics", content.get("intrinsics"), 4)
    distortion = coefficients(path, "distortion_coefficients", content.get("distortion_coefficients", []), lens)
    pose = content.get("T_BS")
    if pose is None:
        raise InputError(f"{path}: T_BS is missing: add the camera's pose")
    camera = camera_from(path, "the camera", np.array(size), intrinsics, distortion, lens)
    data = pose.get("data") if isinstance(pose, dict) else pose
    return placed(path, "", name or path.parent.name, camera, pose_of(path, "T_BS.data", data))
