"""Cameras as YAML: `width`, `height`, `fx`, `fy`, `cx`, `cy` [px] and perhaps `distortion` (OpenCV's coefficients)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ispom.errors import InputError
from ispom.io.mapping import finite_numbers, read_mapping
from ispom.types import Camera

SIZES, INTRINSICS = ("width", "height"), ("fx", "fy", "cx", "cy")
MODELS = ("opencv", "pinhole")
MAX_SIZE_PX = 65_536


def read_camera(path: Path) -> Camera:
    """The camera of a file such as camera.yaml; InputError names the value that is missing or wrong."""
    content = read_mapping(path)
    if content.get("model", MODELS[0]) not in MODELS:
        raise InputError(f"{path}: model is {content['model']}, give a camera of model {' or '.join(MODELS)}")
    return camera_of(path, content)


def camera_of(path: Path, values: dict[Any, Any], where: str = "") -> Camera:
    """The camera of a mapping found in `path` under `where` ("left."); InputError names the value that is wrong."""
    found = {key: finite_numbers(path, f"{where}{key}", [values.get(key)], 1)[0] for key in (*SIZES, *INTRINSICS)}
    for key in ("width", "height", "fx", "fy"):
        if found[key] <= 0:
            raise InputError(f"{path}: {where}{key} is {found[key]:g}, not positive: correct it")
    for key in SIZES:
        if found[key] != int(found[key]) or found[key] > MAX_SIZE_PX:
            raise InputError(f"{path}: {where}{key} is {found[key]:g}, not a size in whole pixels: correct it")
    distortion = finite_numbers(path, f"{where}distortion", values.get("distortion", []), (0, 4, 5, 8))
    width, height = (int(found[key]) for key in SIZES)
    return Camera(width, height, *(found[key] for key in INTRINSICS), distortion=tuple(distortion))
