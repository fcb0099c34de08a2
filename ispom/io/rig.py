"""Rigs as YAML: each camera with its intrinsics and rig_from_CAMERA; the pose of a laser; and the uncertainty.

`video_sigma` and `pair_sigma` hold the standard deviations of `ispom.types.calibration`.
"""

from __future__ import annotations

from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.camera import CAMERA_KEYS, INTRINSICS, SIZES, camera_of, line_delay_entry
from ispom.io.mapping import finite_numbers, read_mapping
from ispom.types import Camera, LensSigma, PairSigma, Rig

CAMERAS = ("video", "left", "right")
SIGMAS = {"video_sigma": LensSigma, "pair_sigma": PairSigma}
MAX_SIGMA = {"offset_px": 10.0, "turn_deg": 2.0}
MAX_SHARE = 0.1
"""Largest other deviations, as in the methods' settings: with more there is no useful start."""
ENTRIES = frozenset((*CAMERAS, "laser", *SIGMAS))


def rig_text(rig: Rig) -> str:
    """Returns the file's content."""
    present = [name for name in CAMERAS if getattr(rig, name) is not None]
    content = {name: _camera_entry(rig, name) for name in present}
    content |= {name: asdict(getattr(rig, name)) for name in SIGMAS if getattr(rig, name) is not None}
    if rig.rig_from_laser is not None:
        content["laser"] = {"rig_from_laser": _pose_entry(rig.rig_from_laser)}
    return yaml.safe_dump(content, sort_keys=False)


def read_rig(path: Path, placed: bool = True) -> Rig:
    """Reads the rig of a file. Raises InputError that names the missing or invalid entry.

    Unless all cameras must be `placed`, the video camera may be without a pose: it is then that of the rig.
    """
    content = read_mapping(path)
    if not set(content) & set(CAMERAS) or not set(content) <= ENTRIES:
        perhaps = ", ".join(("laser", *SIGMAS))
        raise InputError(
            f"{path} must hold entries called video, left or right, perhaps {perhaps}, and no others: correct it"
        )
    found: dict[str, Any] = {name: _sigma(path, name, content.pop(name)) for name in SIGMAS if name in content}
    if "laser" in content:
        laser = content.pop("laser")
        found["rig_from_laser"] = _pose(path, "laser", laser if isinstance(laser, dict) else {})
    for name, entry in content.items():
        found[name], found[f"rig_from_{name}"] = _camera(path, name, entry, placed or name != "video")
    return Rig(**found)


def _camera_entry(rig: Rig, name: Any) -> dict[str, Any]:
    camera, rig_from_camera = rig.camera(name), rig.rig_from(name)
    return {
        **({"model": camera.lens} if camera.lens == "fisheye" else {}),
        **{key: getattr(camera, key) for key in SIZES},
        **{key: float(getattr(camera, key)) for key in INTRINSICS},
        "distortion": [float(v) for v in camera.distortion],
        **line_delay_entry(camera),
        f"rig_from_{name}": _pose_entry(rig_from_camera),
    }


def _pose_entry(pose: Pose) -> dict[str, Any]:
    return {"translation_m": pose.translation.tolist(), "rotation_xyzw": pose.xyzw.tolist()}


def _camera(path: Path, name: str, entry: Any, placed: bool) -> tuple[Camera, Pose]:
    if not isinstance(entry, dict):
        raise InputError(f"{path}: {name} must hold the camera's values: correct it")
    camera = camera_of(path, entry, f"{name}.")
    nowhere = entry.get(f"rig_from_{name}") is None and not placed
    pose = Pose() if nowhere else _pose(path, name, entry)
    known = (*CAMERA_KEYS, f"rig_from_{name}")
    others = [str(key) for key in entry if key not in known]
    if others:
        raise InputError(f"{path}: {name}.{others[0]} is not known, as a camera has {', '.join(known)}: correct it")
    return camera, pose


def _sigma(path: Path, name: str, entry: Any) -> LensSigma | PairSigma:
    known = [field.name for field in fields(SIGMAS[name])]
    if not isinstance(entry, dict) or set(entry) != set(known):
        raise InputError(f"{path}: {name} must hold {', '.join(known)}, and no others: correct it")
    values = {key: finite_numbers(path, f"{name}.{key}", [entry[key]], 1)[0] for key in known}
    for key, value in values.items():
        most = MAX_SIGMA.get(key, MAX_SHARE)
        if not 0 <= value <= most:
            raise InputError(f"{path}: {name}.{key} is {value:g}, give a value from 0 to {most:g}")
    return SIGMAS[name](**values)


def _pose(path: Path, name: str, entry: dict[Any, Any]) -> Pose:
    """rig_from_NAME."""
    pose = entry.get(f"rig_from_{name}")
    if not isinstance(pose, dict):
        or_find = ", or find it by `ispom calibrate rig FOLDER --from-motion`" if name == "video" else ""
        raise InputError(f"{path}: {name}.rig_from_{name} is missing: add its translation_m and rotation_xyzw{or_find}")
    translation = finite_numbers(path, f"{name}.rig_from_{name}.translation_m", pose.get("translation_m"), 3)
    key = "rotation_wxyz" if "rotation_wxyz" in pose and "rotation_xyzw" not in pose else "rotation_xyzw"
    xyzw = finite_numbers(path, f"{name}.rig_from_{name}.{key}", pose.get(key), 4)
    xyzw = [*xyzw[1:], xyzw[0]] if key == "rotation_wxyz" else xyzw
    if abs(np.linalg.norm(xyzw) - 1) > 0.01:
        raise InputError(f"{path}: {name}.rig_from_{name}.{key} is not of length 1: correct it")
    return Pose.from_xyzw(np.array(xyzw), np.array(translation))
