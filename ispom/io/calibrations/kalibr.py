"""Kalibr's camchain.yaml: cam0, cam1, ... with T_cn_cnm1, the pose of each camera after the one before."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.placed import Placed, camera_from, distortion_name, flow, matrix_of, pose_of
from ispom.io.mapping import finite_numbers, read_mapping

MODELS = {"none": "opencv", "radtan": "opencv", "equidistant": "fisheye"}


def kalibr_text(cameras: list[Placed]) -> str:
    """In the order given; Kalibr has no rational lens: InputError for one."""
    chain: dict[str, Any] = {}
    before: Pose | None = None
    for n, each in enumerate(cameras):
        camera = each.camera
        entry: dict[str, Any] = {
            "camera_model": "pinhole",
            "distortion_model": distortion_name(camera, {"opencv": "radtan", "fisheye": "equidistant"}, "Kalibr", 4),
            "distortion_coeffs": [*camera.distortion, 0.0, 0.0, 0.0, 0.0][:4],
            "intrinsics": [camera.fx, camera.fy, camera.cx, camera.cy],
            "resolution": [camera.width, camera.height],
            "rostopic": f"/{each.name}/image_raw",
        }
        if before is not None:
            entry["T_cn_cnm1"] = matrix_of(each.body_from_camera.inverse() @ before)
        chain[f"cam{n}"] = entry
        before = each.body_from_camera
    return yaml.dump(chain, Dumper=flow(), sort_keys=False, width=200)


def read_kalibr(path: Path) -> list[Placed]:
    """The cameras; cam0 is the body. InputError names the entry that is missing or wrong."""
    content = read_mapping(path)
    names = sorted((key for key in content if isinstance(key, str) and key.startswith("cam")), key=lambda key: key[3:])
    if not names:
        raise InputError(f"{path} holds no cam0: give a camchain of Kalibr")
    out: list[Placed] = []
    for name in names:
        entry = content[name]
        if not isinstance(entry, dict) or entry.get("camera_model", "pinhole") != "pinhole":
            raise InputError(f"{path}: {name} is no pinhole camera: give one of camera_model pinhole")
        lens = MODELS.get(str(entry.get("distortion_model", "none")))
        if lens is None:
            raise InputError(
                f"{path}: {name}.distortion_model is {entry['distortion_model']}: give radtan or equidistant"
            )
        size = finite_numbers(path, f"{name}.resolution", entry.get("resolution"), 2)
        intrinsics = finite_numbers(path, f"{name}.intrinsics", entry.get("intrinsics"), 4)
        distortion = finite_numbers(path, f"{name}.distortion_coeffs", entry.get("distortion_coeffs", []), (0, 4))
        pose = Pose()
        if out:
            pose = out[-1].body_from_camera @ pose_of(path, f"{name}.T_cn_cnm1", entry.get("T_cn_cnm1")).inverse()
        camera = camera_from(path, name, np.array(size), intrinsics, distortion, lens)
        out.append(Placed(name, camera, pose))
    return out
