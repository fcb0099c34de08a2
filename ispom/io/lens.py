"""What files of any program say about a lens: its model by its many names, its coefficients, its camera matrix."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ispom.cameras import CAMERA_MODELS, model_of
from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.mapping import finite_numbers

MODEL_KEYS = ("distortion_model", "distortion_type", "camera_model", "camera_type", "projection_model")
"""Entries that name a model, in other programs' files."""
FISHEYE_FLAGS = ("fisheye_model", "fisheye", "is_fisheye", "use_fisheye")
"""Entries that say yes or no to a fisheye lens, as OpenCV's calibration sample writes it."""
_NEUTRAL = frozenset({"", "none", "pinhole", "perspective", "null"})
"""Names of a projection without a word about its distortion."""
_LENSES: dict[str, str] = {
    **dict.fromkeys(("opencv", "plumbbob", "radtan", "radialtangential", "radtan5", "radtan8"), "opencv"),
    **dict.fromkeys(("rationalpolynomial", "rational", "brown", "brownconrady", "standard"), "opencv"),
    **dict.fromkeys(("fisheye", "equidistant", "equi", "opencvfisheye"), "fisheye"),
    **dict.fromkeys(("kannalabrandt", "kannalabrandt4", "kannalabrandt8", "kb", "kb4"), "fisheye"),
}
COUNTS = {"opencv": (4, 5, 8), "fisheye": (4,)}
"""Numbers of coefficients that `Camera.distortion` may have with one of OpenCV's lenses."""
MOST_COEFFICIENTS = 14
"""Of OpenCV's lenses with a thin prism and a tilted sensor."""
LARGEST_SKEW = 0.05
"""As a share of the focal length: no sensor has more."""


def lens_of(
    path: Path, content: Mapping[Any, Any], where: str = "", n: str = "", keys: tuple[str, ...] = MODEL_KEYS
) -> str:
    """The lens that the entries `keys` of a file name ("cam0." is `where` they are, `n` the camera's number behind
    their names); a perspective one where they name none.

    A model of an installed package is named as it is registered. Raises InputError for a model that is not known, and
    for two that differ.
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
    """Distortion in OpenCV's order, as many numbers as `Camera.distortion` may have: zeros at the end may be more or
    fewer. InputError where others than zeros would be lost."""
    if lens not in COUNTS:  # a model of a package: it says how many it has
        return finite_numbers(path, where, value, model_of(lens, 0).counts)
    try:
        found = finite_numbers(path, where, value, (0, *range(4, MOST_COEFFICIENTS + 1)))
    except InputError:
        found = finite_numbers(path, where, value, (0, *COUNTS[lens]))  # which raises, and names the usual counts
    if not found or len(found) in COUNTS[lens]:
        return found
    used = len(np.trim_zeros(found, "b"))
    if lens == "fisheye" and used > 4:
        raise InputError(f"{path}: {where} has {used} coefficients, but a fisheye lens has 4: correct it")
    if used > 8:
        raise InputError(f"{path}: {where} has a thin prism or tilted sensor: calibrate with 8 coefficients")
    if used > 5 and len(found) < 8:
        raise InputError(
            f"{path}: {where} has {len(found)} coefficients, but OpenCV's lenses have 4, 5 or 8: correct it"
        )
    return [*found, 0.0][: next(count for count in COUNTS[lens] if count >= used)]


def intrinsics_of(path: Path, where: str, matrix: Array) -> tuple[list[float], tuple[str, ...]]:
    """fx, fy, cx, cy of a camera matrix (3, 3), and a note about a skew; InputError where it is none, such as the
    transposed ones that MATLAB prints."""
    fx, skew, fy = float(matrix[0, 0]), float(matrix[0, 1]), float(matrix[1, 1])
    last = matrix[2]
    if np.abs(last - (0, 0, 1)).max() > 1e-9:
        said = " ".join(f"{value:g}" for value in last)
        turned = not matrix[:2, 2].any() and last[2] == 1
        cure = "it is transposed, as MATLAB prints it: exchange its rows and columns" if turned else "correct it"
        raise InputError(f"{path}: the last row of {where} is {said}, not 0 0 1: {cure}")
    if matrix[1, 0] != 0 or abs(skew) > LARGEST_SKEW * abs(fx):
        raise InputError(
            f"{path}: {where} has {skew:g} and {matrix[1, 0]:g} beside its focal lengths, where 0 should be: correct it"
        )
    note = f"{path}: the skew of {skew:g} px in {where} is skipped, as cameras here have none"
    return [fx, fy, float(matrix[0, 2]), float(matrix[1, 2])], (note,) if skew else ()
