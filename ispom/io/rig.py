"""Rigs as YAML: each camera with its intrinsics and rig_from_CAMERA; the pose of a laser; and the uncertainty.

`video_sigma` and `pair_sigma` hold the standard deviations of those names. Any other entry is another sensor by
name: `sensor` is its kind (imu, gnss, wheel, laser, or camera), `rig_from_NAME` its pose, the rest its noise.
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
from ispom.io.values import CAMERAS, is_sensor_name
from ispom.types import (
    Camera,
    CameraSensor,
    GnssAntenna,
    Imu,
    LaserScanner,
    LensSigma,
    PairSigma,
    Rig,
    Sensor,
    WheelOdometer,
)

SIGMAS = {"video_sigma": LensSigma, "pair_sigma": PairSigma}
MAX_SIGMA = {"offset_px": 10.0, "turn_deg": 2.0}
MAX_SHARE = 0.1
"""Largest of the other standard deviations, as in the methods' settings: with larger ones optimisation has no useful
start."""
ENTRIES = frozenset((*CAMERAS, "laser", *SIGMAS))
"""Entries that only a rig.yaml has."""
OTHERS: dict[str, type[Sensor]] = {s.kind: s for s in (Imu, GnssAntenna, WheelOdometer, LaserScanner)}
MIN_NOISE, MAX_NOISE = 1e-12, 1e3


def rig_text(rig: Rig) -> str:
    """Returns the file's content."""
    present = [name for name in CAMERAS if getattr(rig, name) is not None]
    content = {name: _camera_entry(rig, name) for name in present}
    content |= {name: asdict(getattr(rig, name)) for name in SIGMAS if getattr(rig, name) is not None}
    content |= {name: _other_entry(name, s) for name, s in rig.sensors.items() if name not in CAMERAS}
    return yaml.safe_dump(content, sort_keys=False)


def read_rig(path: Path, placed: bool = True) -> Rig:
    """Reads the rig of a file. Raises InputError that names the missing or invalid entry.

    Unless all cameras must be `placed`, the video camera may be without a pose: it is then that of the rig.
    """
    content = read_mapping(path)
    sigmas = {name: _sigma(path, name, content.pop(name)) for name in SIGMAS if name in content}
    others = {name: content.pop(name) for name in [*content] if name not in CAMERAS}
    unknown = [name for name, entry in others.items() if name != "laser" and not _is_sensor(name, entry)]
    extra_cameras = any(isinstance(entry, dict) and entry.get("sensor") == "camera" for entry in others.values())
    if not (content or extra_cameras) or unknown:
        perhaps = ", ".join(("laser", *SIGMAS))
        raise InputError(
            f"{path} must hold entries called video, left or right, perhaps {perhaps}, or sensors that name their kind "
            f"in `sensor` ({', '.join(('camera', *OTHERS))}), and no others: correct it"
        )
    entries: dict[str, Any] = {}
    for name, entry in content.items():
        entries[name], entries[f"rig_from_{name}"] = _camera(path, name, entry, placed or name != "video")
    for name, entry in others.items():
        entries[name] = sensor_of(path, name, entry if isinstance(entry, dict) else {})
    return Rig.of(**entries, **sigmas)


def _is_sensor(name: Any, entry: Any) -> bool:
    """Checks for an entry that is a sensor by its kind."""
    return is_sensor_name(name) and isinstance(entry, dict) and entry.get("sensor") in ("camera", *OTHERS)


def sensor_of(path: Path, name: str, entry: dict[Any, Any]) -> Sensor:
    """Returns a sensor other than the usual cameras from its entry. Raises InputError that names the invalid value."""
    kind = entry.get("sensor", name)
    if name in OTHERS and kind != name:
        raise InputError(f"{path}: {name} is the name of another kind of sensor than {kind}: choose another name")
    values = {key: value for key, value in entry.items() if key not in ("sensor", f"rig_from_{name}")}
    if kind == "camera":
        camera, pose = _camera(path, name, {k: v for k, v in entry.items() if k != "sensor"}, True)
        return CameraSensor(camera=camera, rig_from_sensor=pose)
    pose, noises = (
        _pose(path, name, entry),
        [field.name for field in fields(OTHERS[kind]) if field.name != "rig_from_sensor"],
    )
    if unknown := [str(key) for key in values if key not in noises]:
        known = ", ".join((f"rig_from_{name}", *noises))
        raise InputError(f"{path}: {name}.{unknown[0]} is not known, as it has {known}: correct it")
    noise = {
        key: finite_numbers(path, f"{name}.{key}", [value], 1, MIN_NOISE, MAX_NOISE)[0] for key, value in values.items()
    }
    return OTHERS[kind](rig_from_sensor=pose, **noise)


def _other_entry(name: str, sensor: Sensor) -> dict[str, Any]:
    """Returns the entry of a sensor other than the rig's usual cameras."""
    if isinstance(sensor, CameraSensor):
        return {"sensor": "camera", **_camera_entry(Rig({name: sensor}), name)}
    noise = {f.name: getattr(sensor, f.name) for f in fields(sensor) if f.name != "rig_from_sensor"}
    changed = {key: value for key, value in noise.items() if value != getattr(type(sensor), key)}
    kind = {} if name == sensor.kind == "laser" else {"sensor": sensor.kind}
    return {**kind, f"rig_from_{name}": _pose_entry(sensor.rig_from_sensor), **changed}


def _camera_entry(rig: Rig, name: Any) -> dict[str, Any]:
    camera, rig_from_camera = rig.camera(name), rig.rig_from(name)
    return {
        **({"model": camera.lens} if camera.lens != "opencv" else {}),
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
    values = {
        key: finite_numbers(path, f"{name}.{key}", [entry[key]], 1, 0, MAX_SIGMA.get(key, MAX_SHARE))[0]
        for key in known
    }
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
