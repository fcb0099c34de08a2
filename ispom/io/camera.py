"""Cameras as YAML: `width`, `height`, `fx`, `fy`, `cx`, `cy` [px] and perhaps `distortion` (OpenCV's coefficients).

`model: fisheye` says that these are the four of a fisheye lens, as do the names that other programs have for it
(`distortion_model: equidistant`, `fisheye_model: 1`); `line_delay_s` says that the shutter rolls.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ispom.errors import InputError
from ispom.io.lens import FISHEYE_FLAGS, MODEL_KEYS, coefficients, lens_of
from ispom.io.mapping import finite_numbers, read_mapping
from ispom.types import Camera

SIZES, INTRINSICS = ("width", "height"), ("fx", "fy", "cx", "cy")
LINE_DELAY = "line_delay_s"
CAMERA_KEYS = ("model", *SIZES, *INTRINSICS, "distortion", LINE_DELAY)
LENS_KEYS = ("model", *MODEL_KEYS)
"""Entries that may name the lens."""
SINGLE_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
"""In the order of `distortion`, which they stand for; of a fisheye k1 to k4."""
FOREIGN_KEYS = (*MODEL_KEYS, *FISHEYE_FLAGS, *SINGLE_COEFFICIENTS)
"""Entries of other programs that are understood in a camera.yaml, too."""
CLOCK_KEYS = ("times", "rate_hz", "offset_s")
"""Entries about the images of a camera, which may stand in a camera.yaml."""
MAX_READOUT_S = 1.0
"""From the first row of a rolling shutter to its last."""
MAX_SIDE_PX = 32_766
"""OpenCV's remapping counts pixels in 16 bits."""
MAX_PIXELS = 1 << 26
"""67 million: of a stereo pair with colours and its rectification, 1.2 GB."""
MIN_FOCAL, MAX_FOCAL = 0.01, 1000.0
"""Focal lengths, as a share of the longer side: views from 179° down to 0.06°."""
MAX_CENTRE = 10.0
"""The principal point is at most so many longer sides from the image's centre."""
MAX_COEFFICIENT = 1e4
USUAL_CENTRE = 0.25
"""The principal point is rarely farther from the image's centre than this share of its side,"""
USUAL_ASPECT = 1.2
"""one focal length rarely longer than so many times the other,"""
USUAL_FOCAL = 0.12
"""and that of a lens that is no fisheye rarely shorter than this share of the longer side (a view of 153 degrees)."""
UNDONE_PX = 1.0
"""A pixel's distortion counts as undone where distorting again leads back this near."""


def read_camera(path: Path) -> Camera:
    """The camera of a file such as camera.yaml; InputError names the value that is missing or wrong."""
    return camera_of(path, read_mapping(path))


def camera_of(path: Path, values: dict[Any, Any], where: str = "") -> Camera:
    """The camera of a mapping found in `path` under `where` ("left."); InputError names the value that is wrong."""
    lens = lens_of(path, values, where, keys=LENS_KEYS)
    found = {key: finite_numbers(path, f"{where}{key}", [values.get(key)], 1)[0] for key in (*SIZES, *INTRINSICS)}
    for key in ("width", "height", "fx", "fy"):
        if found[key] <= 0:
            raise InputError(f"{path}: {where}{key} is {found[key]:g}, not positive: correct it")
    for key in SIZES:
        if found[key] != int(found[key]):
            raise InputError(f"{path}: {where}{key} is {found[key]:g}, not a size in whole pixels: correct it")
    distortion = coefficients(path, f"{where}distortion", _distortion(path, where, values, lens), lens)
    width, height = (int(found[key]) for key in SIZES)
    delay_s = finite_numbers(path, f"{where}{LINE_DELAY}", [values.get(LINE_DELAY, 0)], 1)[0]
    if abs(delay_s) * height > MAX_READOUT_S:
        limit = f"from the first row to the last are at most {MAX_READOUT_S:g} s"
        raise InputError(f"{path}: {where}{LINE_DELAY} is {delay_s:g}, but {limit}: correct it")
    intrinsics = [found[key] for key in INTRINSICS]
    camera = Camera(width, height, *intrinsics, distortion=tuple(distortion), lens=lens, line_delay_s=delay_s)
    return usable(camera, f"{path}: {where.rstrip('.')}".rstrip(": "))


def skipped_note(path: Path, values: dict[Any, Any]) -> tuple[str, ...]:
    """A note about entries of a camera.yaml that are not known, as a misspelt one would go unnoticed."""
    known = (*CAMERA_KEYS, *CLOCK_KEYS)
    others = [str(key) for key in values if key not in (*known, *FOREIGN_KEYS)]
    note = f"{path}: {', '.join(others)} skipped, as the entries of a camera are {', '.join(known)}"
    return (note,) if others else ()


def _distortion(path: Path, where: str, values: dict[Any, Any], lens: str) -> Any:
    """`distortion`, or else what single coefficients say."""
    names = ("k1", "k2", "k3", "k4") if lens == "fisheye" else SINGLE_COEFFICIENTS
    single = [name for name in SINGLE_COEFFICIENTS if name in values]
    if not single:
        return values.get("distortion", [])
    if "distortion" in values:
        raise InputError(f"{path}: {where}distortion and {where}{single[0]} are both given: remove one")
    if strange := [name for name in single if name not in names]:
        raise InputError(f"{path}: {where}{strange[0]} is none of a fisheye's {', '.join(names)}: correct it")
    found = [finite_numbers(path, f"{where}{name}", [values.get(name, 0)], 1)[0] for name in names]
    used = max(names.index(name) for name in single) + 1
    return found[: next(count for count in (4, 5, 8) if count >= used)]


def line_delay_entry(camera: Camera) -> dict[str, float]:
    """What a file says of the shutter: nothing unless it rolls."""
    return {LINE_DELAY: camera.line_delay_s} if camera.line_delay_s else {}


def usable(camera: Camera, where: str) -> Camera:
    """The camera, where images can be of it; InputError, beginning with `where`, says what is impossible about it.

    Its image has at most MAX_SIDE_PX a side and MAX_PIXELS in all, which is known before memory is taken for it.
    """
    width, height = camera.width, camera.height
    if not (0 < width <= MAX_SIDE_PX and 0 < height <= MAX_SIDE_PX and width * height <= MAX_PIXELS):
        limit = f"{MAX_SIDE_PX} px a side and {MAX_PIXELS} px in all"
        raise InputError(f"{where}: the image size {width} x {height} is not within 1 to {limit}: correct it")
    longer = max(width, height)
    for key in ("fx", "fy"):
        focal = getattr(camera, key)
        if focal <= 0:
            raise InputError(f"{where}: {key} is {focal:g}, not positive: correct it")
        if not MIN_FOCAL * longer <= focal <= MAX_FOCAL * longer:
            limits = f"{MIN_FOCAL:g} to {MAX_FOCAL:g} times the longer side of {longer} px"
            raise InputError(f"{where}: {key} is {focal:g} px, not within {limits}: correct it")
    for key, side in (("cx", width), ("cy", height)):
        if not abs(getattr(camera, key) - side / 2) <= MAX_CENTRE * longer:
            raise InputError(f"{where}: {key} is {getattr(camera, key):g} px, far outside of the image: correct it")
    if not _distortion_undone(camera):
        raise InputError(f"{where}: the distortion cannot be undone in half of the image: correct its coefficients")
    return camera


def doubts(camera: Camera, where: str) -> tuple[str, ...]:
    """Sentences, beginning with `where`, about values that are possible, but more likely a mistake."""
    out = []
    for key, side in (("cx", camera.width), ("cy", camera.height)):
        value = getattr(camera, key)
        if abs(value - (side - 1) / 2) > USUAL_CENTRE * side:
            out.append(f"{where}: {key} is {value:g} px, far from the middle of {side} px: check it")
    if not 1 / USUAL_ASPECT <= camera.fx / camera.fy <= USUAL_ASPECT:
        out.append(
            f"{where}: fx is {camera.fx:g} px and fy {camera.fy:g} px, as of pixels that are not square: check it"
        )
    if camera.lens == "opencv" and min(camera.fx, camera.fy) < USUAL_FOCAL * camera.longer_side_px:
        out.append(f"{where}: fx is {camera.fx:g} px, very short for a lens that is no fisheye: is it in millimetres?")
    return tuple(out)


def _distortion_undone(camera: Camera) -> bool:
    """Whether it can be, for half of the pixels at least: fitted polynomials often turn back in the corners."""
    if not camera.distortion:
        return True
    if not max(map(abs, camera.distortion)) <= MAX_COEFFICIENT:
        return False
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 9), np.linspace(0, camera.height - 1, 9))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    rays = np.column_stack([camera.normalise(uv), np.ones(len(uv))])
    with np.errstate(all="ignore"):
        away_px = np.linalg.norm(camera.project(rays) - uv, axis=1)
    return bool((away_px <= UNDONE_PX).mean() >= 0.5)
