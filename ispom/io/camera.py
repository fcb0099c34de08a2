"""Cameras as YAML: `width`, `height`, `fx`, `fy`, `cx`, `cy` [px] and, optionally, `distortion` (OpenCV's
coefficients).

`model: equirectangular` is a 360-degree image, twice as wide as high, of which `width` and `height` say everything;
`model: fisheye` marks the four coefficients of a fisheye lens, as do the names of other programs (`distortion_model:
equidistant`, `fisheye_model: 1`); `line_delay_s` is that of a rolling shutter.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ispom.cameras import CAMERA_MODELS, EQUIRECTANGULAR, model_of
from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.mapping import finite_numbers
from ispom.types import Camera

MODEL_KEYS = ("distortion_model", "distortion_type", "camera_model", "camera_type", "projection_model")
"""Entries of other programs' files that name the camera model."""
FISHEYE_FLAGS = ("fisheye_model", "fisheye", "is_fisheye", "use_fisheye")
"""Yes-or-no entries for a fisheye lens, as OpenCV's calibration sample writes them."""
_NEUTRAL = frozenset({"", "none", "pinhole", "perspective", "null"})
"""Names of a projection that do not define its distortion."""
_LENSES: dict[str, str] = {
    **dict.fromkeys(("opencv", "plumbbob", "radtan", "radialtangential", "radtan4", "radtan5", "radtan8"), "opencv"),
    **dict.fromkeys(("rationalpolynomial", "rational", "brown", "brownconrady", "standard"), "opencv"),
    **dict.fromkeys(("fisheye", "equidistant", "equi", "equid4", "opencvfisheye"), "fisheye"),
    **dict.fromkeys(("equirectangular", "equirect", "spherical", "panorama", "panoramic"), EQUIRECTANGULAR.name),
    **dict.fromkeys(("kannalabrandt", "kannalabrandt4", "kannalabrandt8", "kb", "kb4"), "fisheye"),
}
COUNTS = {"opencv": (4, 5, 8), "fisheye": (4,)}
"""Numbers of coefficients that `Camera.distortion` may have."""
MOST_COEFFICIENTS = 14
"""Number of OpenCV's coefficients with a thin prism and a tilted sensor."""
MAX_SKEW = 0.05
"""Largest skew relative to the focal length; with more, an entry is likely wrong, as sensors have nearly none."""


def lens_of(
    path: Path, content: Mapping[Any, Any], where: str = "", n: str = "", keys: tuple[str, ...] = MODEL_KEYS
) -> str:
    """Returns the lens that the entries `keys` of a file name; perspective where there are none.

    `where` is the prefix of the entries, such as "cam0.", and `n` the camera's number at the end of their names. Raises
    InputError for an unknown model, and for two that differ.
    """
    named: dict[str, str] = {}
    for key in dict.fromkeys(f"{key}{suffix}" for key in keys for suffix in (n, "")):
        value = content.get(key)
        word = re.sub(r"[^a-z0-9]", "", str(value if value is not None else "").lower())
        if word in _NEUTRAL:
            continue
        lens = _LENSES.get(word) or (value if value in CAMERA_MODELS.names() else None)
        if lens is None:
            raise InputError(
                f"{path}: {where}{key} is {str(value)[:40]}, which is no pinhole camera with OpenCV's distortion and "
                "no fisheye (equidistant) one: calibrate it as one of these"
            )
        named[lens] = f"{where}{key} is {value}"
    for key in dict.fromkeys(f"{key}{suffix}" for key in FISHEYE_FLAGS for suffix in (n, "")):
        if str(content.get(key, "")).strip().lower() in ("1", "1.0", "true", "yes", "on"):
            named["fisheye"] = f"{where}{key} is {content[key]}"
    if len(named) > 1:
        raise InputError(f"{path}: {' but '.join(named.values())}: correct the one that is wrong")
    return next(iter(named), "opencv")


def coefficients(path: Path, where: str, value: Any, lens: str) -> list[float]:
    """Returns the distortion in OpenCV's order, with a number of coefficients that `Camera.distortion` may have: adds
    or removes zeros at the end. Raises InputError where coefficients other than zero would be lost."""
    if lens not in COUNTS:  # a model of a package, which defines the number itself
        return finite_numbers(path, where, value, model_of(lens, 0).counts)
    try:
        values = finite_numbers(path, where, value, (0, *range(4, MOST_COEFFICIENTS + 1)))
    except InputError:
        values = finite_numbers(path, where, value, (0, *COUNTS[lens]))  # raises with the usual counts
    if not values or len(values) in COUNTS[lens]:
        return values
    used = len(np.trim_zeros(values, "b"))
    if lens == "fisheye" and used > 4:
        raise InputError(f"{path}: {where} has {used} coefficients, but a fisheye lens has 4: correct it")
    if used > 8:
        raise InputError(f"{path}: {where} has a thin prism or tilted sensor: calibrate with 8 coefficients")
    if used > 5 and len(values) < 8:
        raise InputError(
            f"{path}: {where} has {len(values)} coefficients, but OpenCV's lenses have 4, 5 or 8: correct it"
        )
    return [*values, 0.0][: next(count for count in COUNTS[lens] if count >= used)]


def intrinsics_of(path: Path, where: str, matrix: Array) -> tuple[list[float], tuple[str, ...]]:
    """Returns fx, fy, cx, cy of a camera matrix (3, 3), and a note about a skew. Raises InputError where it is none."""
    fx, skew, fy = float(matrix[0, 0]), float(matrix[0, 1]), float(matrix[1, 1])
    last = matrix[2]
    if np.abs(last - (0, 0, 1)).max() > 1e-9:
        row = " ".join(f"{value:g}" for value in last)
        turned = not matrix[:2, 2].any() and last[2] == 1
        cure = "it is transposed, as MATLAB prints it: exchange its rows and columns" if turned else "correct it"
        raise InputError(f"{path}: the last row of {where} is {row}, not 0 0 1: {cure}")
    if matrix[1, 0] != 0 or abs(skew) > MAX_SKEW * abs(fx):
        raise InputError(
            f"{path}: {where} has {skew:g} and {matrix[1, 0]:g} next to its focal lengths, where 0 should be: "
            "correct it"
        )
    note = f"{path}: the skew of {skew:g} px in {where} is skipped, as cameras here have none"
    return [fx, fy, float(matrix[0, 2]), float(matrix[1, 2])], (note,) if skew else ()


SIZES, INTRINSICS = ("width", "height"), ("fx", "fy", "cx", "cy")
LINE_DELAY = "line_delay_s"
CAMERA_KEYS = ("model", *SIZES, *INTRINSICS, "distortion", LINE_DELAY)
LENS_KEYS = ("model", *MODEL_KEYS)
"""Entries that may name the lens."""
SINGLE_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
"""Names of the coefficients in the order of `distortion`; those of a fisheye lens are k1 to k4."""
FOREIGN_KEYS = (*MODEL_KEYS, *FISHEYE_FLAGS, *SINGLE_COEFFICIENTS)
"""Entries of other programs that are also accepted in a camera.yaml."""
CLOCK_KEYS = ("times", "rate_hz", "offset_s")
"""Entries about the images of a camera, which a camera.yaml may have."""
MAX_READOUT_S = 1.0
"""Largest duration from the first row of a rolling shutter to its last."""
MAX_SIDE_PX = 32_766
"""OpenCV's remapping counts pixels in 16 bits."""
MAX_PIXELS = 1 << 26
"""Largest number of pixels of an image: a stereo pair in colour with its rectification then takes 1.2 GB."""
MIN_FOCAL, MAX_FOCAL = 0.01, 1000.0
"""Range of focal lengths, relative to the longer side: fields of view from 179 down to 0.06 degrees."""
MAX_CENTRE = 10.0
"""Largest distance of the principal point from the image's centre, in longer sides."""
MAX_COEFFICIENT = 1e4
"""Largest magnitude of a distortion coefficient; larger ones are no results of a calibration."""
MAX_INVERSION_ERROR_PX = 1.0
"""Largest distance between a pixel and its position after undistortion and distortion, if the distortion is
invertible."""


def camera_of(path: Path, values: dict[Any, Any], where: str = "") -> Camera:
    """Reads a mapping of `path` under `where` ("left."). Raises InputError that names the invalid value."""
    lens = lens_of(path, values, where, keys=LENS_KEYS)
    if lens == EQUIRECTANGULAR.name:
        values = _panoramic(path, values, where)
    numbers = {key: finite_numbers(path, f"{where}{key}", [values.get(key)], 1)[0] for key in (*SIZES, *INTRINSICS)}
    for key in ("width", "height", "fx", "fy"):
        if numbers[key] <= 0:
            raise InputError(f"{path}: {where}{key} is {numbers[key]:g}, not positive: correct it")
    for key in SIZES:
        if numbers[key] != int(numbers[key]):
            raise InputError(f"{path}: {where}{key} is {numbers[key]:g}, not a size in whole pixels: correct it")
    distortion = coefficients(path, f"{where}distortion", _distortion(path, where, values, lens), lens)
    width, height = (int(numbers[key]) for key in SIZES)
    delay_s = finite_numbers(path, f"{where}{LINE_DELAY}", [values.get(LINE_DELAY, 0)], 1)[0]
    if abs(delay_s) * height > MAX_READOUT_S:
        limit = f"from the first row to the last are at most {MAX_READOUT_S:g} s"
        raise InputError(f"{path}: {where}{LINE_DELAY} is {delay_s:g}, but {limit}: correct it")
    intrinsics = [numbers[key] for key in INTRINSICS]
    camera = Camera(width, height, *intrinsics, distortion=tuple(distortion), lens=lens, line_delay_s=delay_s)
    return usable(camera, f"{path}: {where.rstrip('.')}".rstrip(": "))


def _panoramic(path: Path, values: dict[Any, Any], where: str) -> dict[Any, Any]:
    """Returns the entries of a 360-degree image with those that follow from its size. Raises InputError where the size
    is not that of the whole sphere, or an entry differs."""
    width, height = (finite_numbers(path, f"{where}{key}", [values.get(key)], 1)[0] for key in SIZES)
    if width != 2 * height:
        raise InputError(
            f"{path}: {where}width and {where}height are {width:g} and {height:g}, but a 360-degree image is twice as "
            "wide as high: give the whole image, or a pinhole or fisheye model for a part of it"
        )
    whole = EQUIRECTANGULAR.camera(int(width), int(height))
    for key in INTRINSICS:
        value = finite_numbers(path, f"{where}{key}", [values.get(key, getattr(whole, key))], 1)[0]
        if abs(value - getattr(whole, key)) > 1e-3:
            raise InputError(
                f"{path}: {where}{key} is {value:g}, but that of a 360-degree image of this size is "
                f"{getattr(whole, key):g}: leave it out"
            )
    if line := values.get(LINE_DELAY):
        raise InputError(f"{path}: {where}{LINE_DELAY} is {line}, and a 360-degree image has none here: leave it out")
    return {**values, **{key: getattr(whole, key) for key in INTRINSICS}}


def skipped_note(path: Path, values: dict[Any, Any]) -> tuple[str, ...]:
    """Returns a note about unknown entries of a camera.yaml, as a misspelt one would go unnoticed."""
    known = (*CAMERA_KEYS, *CLOCK_KEYS)
    others = [str(key) for key in values if key not in (*known, *FOREIGN_KEYS)]
    note = f"{path}: {', '.join(others)} skipped, as the entries of a camera are {', '.join(known)}"
    return (note,) if others else ()


def _distortion(path: Path, where: str, values: dict[Any, Any], lens: str) -> Any:
    """Returns `distortion`, or the single coefficients."""
    names = ("k1", "k2", "k3", "k4") if lens == "fisheye" else SINGLE_COEFFICIENTS
    single = [name for name in SINGLE_COEFFICIENTS if name in values]
    if not single:
        return values.get("distortion", [])
    if "distortion" in values:
        raise InputError(f"{path}: {where}distortion and {where}{single[0]} are both given: remove one")
    if strange := [name for name in single if name not in names]:
        raise InputError(f"{path}: {where}{strange[0]} is none of a fisheye's {', '.join(names)}: correct it")
    distortion = [finite_numbers(path, f"{where}{name}", [values.get(name, 0)], 1)[0] for name in names]
    used = max(names.index(name) for name in single) + 1
    return distortion[: next(count for count in (4, 5, 8) if count >= used)]


def line_delay_entry(camera: Camera) -> dict[str, float]:
    """Returns the entries of a rolling shutter; none for a global one."""
    return {LINE_DELAY: camera.line_delay_s} if camera.line_delay_s else {}


def usable(camera: Camera, where: str) -> Camera:
    """Returns the camera if it is possible. Raises InputError, which begins with `where`, for an impossible one.

    Its image has at most MAX_SIDE_PX a side and MAX_PIXELS in all: checked before memory is allocated.
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


def _distortion_undone(camera: Camera) -> bool:
    """Returns whether the distortion is invertible for at least half of the pixels: fitted polynomials often fold in
    the corners."""
    if not camera.distortion:
        return True
    if not max(map(abs, camera.distortion)) <= MAX_COEFFICIENT:
        return False
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 9), np.linspace(0, camera.height - 1, 9))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    rays = np.column_stack([camera.normalise(uv), np.ones(len(uv))])
    with np.errstate(all="ignore"):
        away_px = np.linalg.norm(camera.project(rays) - uv, axis=1)
    return bool((away_px <= MAX_INVERSION_ERROR_PX).mean() >= 0.5)
