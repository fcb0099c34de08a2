"""The focal length of a camera without a calibration: from the file's metadata, or else a guess; both are reported.

Photos may have it in their EXIF, films of phones in QuickTime's metadata, both as the equivalent on 35 mm film. The
principal point is assumed in the middle, and lenses without distortion.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from PIL import Image as Header

from ispom.errors import InputError
from ispom.io.files import exists, opened, read_head
from ispom.sequences.quicktime import quicktime_metadata
from ispom.types import Camera, Guess

FILM_DIAGONAL_MM = 43.267
"""Diagonal of 36 x 24 mm, by which focal lengths "in 35 mm film" are defined (CIPA DCG-001)."""
USUAL_SHARE, USUAL_SIGMA = 0.7, 0.3
"""Guessed focal length relative to the longer side, and the standard deviation of its logarithm: phones have 0.7 to
0.85, wide lenses of robots and cars 0.5 to 0.6."""
METADATA_SIGMA = 0.05
"""The same standard deviation for a focal length in metadata: it is rounded to millimetres, and films are cropped for
stabilisation."""
MIN_METADATA_SHARE, MAX_METADATA_SHARE = 0.2, 20.0
"""Range of focal lengths in metadata, as a share of the longer side: of lenses of 7 to 720 mm on 35 mm film."""
MAX_ASPECT = 4.0
"""Largest aspect of pixels: those of films have at most 2."""
SENSOR_MM = (2.0, 62.0)
"""Range of the longer side of a sensor: from telephones to medium format."""
_EXIF, _FOCAL_MM, _FOCAL_35_MM = 0x8769, 37386, 41989
_GPS, _LATITUDE, _LONGITUDE = 0x8825, 2, 4
_PLANE_RESOLUTION, _PLANE_UNIT = 41486, 41488
_PIXEL_SIDES = (40962, 40963)
_MM_OF_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
_SUBTITLES = re.compile(r"focal_len\s*:\s*([0-9]{1,4}(?:\.[0-9]{1,4})?)")
_SUBTITLES_HEAD = 4096
"""Number of first bytes of subtitles that are searched."""
_QUICKTIME = "com.apple.quicktime.camera.focal_length.35mm_equivalent"


def guessed(size: tuple[int, int], metadata_focal: tuple[float, str] | None, aspect: float = 1.0) -> Guess:
    """Returns the guess for images of `size` (width, height) with pixels of this `aspect`, width over height.

    `metadata_focal` is a focal length, in heights of a pixel, and the name of its source.
    """
    longer = max(size[0] * aspect, size[1])
    if metadata_focal is not None and MIN_METADATA_SHARE * longer <= metadata_focal[0] <= MAX_METADATA_SHARE * longer:
        return Guess(metadata_focal[0], METADATA_SIGMA, metadata_focal[1], aspect)
    return Guess(USUAL_SHARE * longer, USUAL_SIGMA, f"a guess: {USUAL_SHARE:g} of the longer side", aspect)


def pixel_aspect(width: float, height: float) -> float:
    """Returns the width of a pixel over its height, from the values of a file; 1 for impossible values."""
    if not (width > 0 and height > 0):
        return 1.0
    aspect = width / height
    return aspect if 1 / MAX_ASPECT <= aspect <= MAX_ASPECT else 1.0


def guess_of_photo(path: Path, orientation: int | None = None) -> tuple[Guess, Camera]:
    """Returns the guess, and the camera, from the first image of a folder. Raises InputError where it is no image.

    `orientation` is EXIF's orientation for all images; by default the image's own one is used.
    """
    with opened(path) as file:
        try:
            with Header.open(file) as image:
                size, exif = image.size, _exif_of(image)
                turned = (orientation or exif.get(0x0112, 1)) in (5, 6, 7, 8)
                entries = exif.get_ifd(_EXIF)
                ratio = image.info.get("jfif_density", (1, 1)) if image.info.get("jfif_unit") == 0 else (1, 1)
        except (OSError, ValueError, SyntaxError, Header.DecompressionBombError):
            raise InputError(f"{path} cannot be read: restore it, or give the camera's calibration") from None
    width, height = size[::-1] if turned else size
    aspect = pixel_aspect(*(ratio[::-1] if turned else ratio))
    guess = guessed((width, height), _focal_of_exif(entries, (width, height)), aspect)
    return guess, guess.camera((width, height))


def position_note(path: Path) -> str:
    """Returns a note about the position in a photo's EXIF, which is not used; "" without one."""
    try:
        with opened(path) as file, Header.open(file) as image:
            entries = _exif_of(image).get_ifd(_GPS)
    except (OSError, ValueError, SyntaxError, Header.DecompressionBombError):
        return ""
    if not {_LATITUDE, _LONGITUDE} <= entries.keys():
        return ""
    return f"{path} has a position in its EXIF, as others may have: not used, as it is no pose of the camera"


def _exif_of(image: Header.Image) -> Header.Exif:
    """Returns the EXIF entries; none for a damaged file, which is reported when it is read."""
    try:
        return image.getexif()
    except (OSError, ValueError, SyntaxError):
        return Header.Exif()


def size_of_photo(path: Path, orientation: int | None = None) -> tuple[int, int]:
    """Returns (width, height) of an image after the rotation by its orientation, as in `guess_of_photo`."""
    _, camera = guess_of_photo(path, orientation)
    return camera.width, camera.height


def guess_of_film(path: Path, size: tuple[int, int], aspect: float = 1.0) -> Guess:
    """Returns the guess from a film's metadata, its size (width, height), and the aspect of its pixels."""
    equivalent, source = _number(quicktime_metadata(path).get(_QUICKTIME)), "the film's metadata"
    if equivalent is None and (subtitles := subtitles_of(path)) is not None:
        equivalent, source = _focal_of_subtitles(subtitles), subtitles.name
    if equivalent is None:
        return guessed(size, None, aspect)
    focal = _px_of_35_mm(equivalent, (size[0] * aspect, size[1]))
    return guessed(size, (focal, f"{source}: {equivalent:g} mm on 35 mm film"), aspect)


def subtitles_of(path: Path) -> Path | None:
    """Returns the subtitles next to a film, as drones write them; None without any."""
    return next((place for suffix in (".SRT", ".srt") if exists(place := path.with_suffix(suffix))), None)


def _focal_of_subtitles(path: Path) -> float | None:
    """Returns the focal length [mm on 35 mm film] of a drone's first subtitles; whole numbers from 100 on are
    tenths."""
    match = _SUBTITLES.search(read_head(path, _SUBTITLES_HEAD).decode("utf-8", "replace"))
    if match is None:
        return None
    tenths = "." not in match[1] and int(match[1]) >= 100
    return _number(float(match[1]) / 10 if tenths else match[1])


def _focal_of_exif(entries: dict[int, object], size: tuple[int, int]) -> tuple[float, str] | None:
    if (equivalent := _number(entries.get(_FOCAL_35_MM))) is not None:
        return _px_of_35_mm(equivalent, size), f"EXIF: {equivalent:g} mm on 35 mm film"
    focal_mm, per_unit = _number(entries.get(_FOCAL_MM)), _number(entries.get(_PLANE_RESOLUTION))
    mm = _MM_OF_UNIT.get(int(_number(entries.get(_PLANE_UNIT, 2)) or 0))
    if focal_mm is None or per_unit is None or mm is None:
        return None
    # The resolution is that of the original image, which may have been reduced later.
    sides = [side for tag in _PIXEL_SIDES if (side := _number(entries.get(tag))) is not None]
    taken = max(sides) if sides else max(size)
    if not SENSOR_MM[0] <= taken * mm / per_unit <= SENSOR_MM[1]:
        return None
    reduced = "" if taken == max(size) else f", of an image {taken:g} px wide"
    return focal_mm * per_unit / mm * max(size) / taken, f"EXIF: {focal_mm:g} mm, {per_unit:g} px per unit{reduced}"


def _px_of_35_mm(equivalent_mm: float, size: tuple[float, float]) -> float:
    return equivalent_mm / FILM_DIAGONAL_MM * float(np.hypot(*size))


def _number(value: object) -> float | None:
    """Returns a positive, finite number, or None."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if np.isfinite(number) and number > 0 else None
