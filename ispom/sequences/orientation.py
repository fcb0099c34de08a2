"""One orientation for all photos of a camera.

Phones write their orientation into each photo's EXIF: half of the photos of a board on the ground, seen from above, may
have 180 degrees. The sensor is the same in all photos, so all images of a camera are rotated in the same way.
"""

from __future__ import annotations

import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Header

from ispom.errors import InputError
from ispom.io.files import opened

SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".webp"})
"""Suffixes of files whose EXIF orientation OpenCV applies."""
MAX_SAMPLES = 200
"""Largest number of photos of a folder whose orientation is read."""
UPRIGHT = 1
"""EXIF's value for an image without rotation (EXIF standard, tag Orientation)."""
_TAG = 0x0112
"""Number of the tag Orientation in the EXIF standard."""
_DEGREES = {3: "180", 6: "90", 8: "270"}


def common_orientation(paths: list[Path]) -> tuple[int | None, str]:
    """Returns the most frequent EXIF orientation (1 to 8) of one camera's images, and a note where they differ; None
    for files without EXIF."""
    photos = [path for path in paths if path.suffix.lower() in SUFFIXES]
    if not photos:
        return None, ""
    sampled = [photos[i] for i in np.unique(np.linspace(0, len(photos) - 1, MAX_SAMPLES).round().astype(int))]
    counts = Counter(orientation for orientation in map(_orientation, sampled) if orientation)
    if not counts:
        return None, ""
    common = max(counts, key=lambda each: (counts[each], each == UPRIGHT))
    if len(counts) == 1:
        return common, ""
    listed = ", ".join(f"{n} {_turned(each)}" for each, n in counts.most_common())
    which = "" if len(sampled) == len(photos) else f" ({len(sampled)} looked at)"
    return common, (
        f"{paths[0].parent}: by EXIF, images{which} are to be turned differently: {listed}; as they are of one camera, "
        f"all are taken as {_turned(common)}"
    )


def _turned(orientation: int) -> str:
    if orientation == UPRIGHT:
        return "not turned"
    degrees = _DEGREES.get(orientation)
    return f"mirrored (orientation {orientation})" if degrees is None else f"turned by {degrees} degrees"


def oriented(image: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Returns the image rotated and mirrored by EXIF's `orientation`."""
    if orientation in (5, 6, 7, 8):
        image = image.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        image = image[:, ::-1]
    if orientation in (3, 4, 7, 8):
        image = image[::-1]
    return np.ascontiguousarray(image)


def _orientation(path: Path) -> int:
    """Returns EXIF's orientation, 1 without one; 0 where the file cannot be read."""
    try:
        with warnings.catch_warnings(action="ignore"), opened(path) as file, Header.open(file) as image:
            if "exif" not in image.info:  # getexif would decode a PNG to find an entry after its pixels
                return UPRIGHT
            orientation = image.getexif().get(_TAG, UPRIGHT)
    except (InputError, OSError, ValueError, SyntaxError, Header.DecompressionBombError):
        return 0
    return orientation if isinstance(orientation, int) and 1 <= orientation <= 8 else UPRIGHT
