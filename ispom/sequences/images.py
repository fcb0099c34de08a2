"""Reads image files. The header is read first, and the image is decoded only if it has the expected size."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Header

from ispom.errors import InputError, UnreadableImage
from ispom.io.camera import MAX_PIXELS
from ispom.io.files import names, opened, read_bytes
from ispom.sequences.decoder_output import silenced
from ispom.sequences.image_header import FORMATS, MAX_BYTES, header_size, is_whole
from ispom.sequences.orientation import MAX_SAMPLES as PHOTOS
from ispom.sequences.orientation import oriented
from ispom.types import Image

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp"})
UNREAD_SUFFIXES = frozenset(
    {
        ".heic",
        ".heif",
        ".avif",
        ".jxl",
        ".jp2",
        ".gif",
        ".exr",
        ".dng",
        ".cr2",
        ".cr3",
        ".nef",
        ".arw",
        ".raf",
        ".orf",
        ".rw2",
    }
)
"""Suffixes of images in unsupported formats."""
SAMPLED_IMAGES = 8
"""Number of images of a folder from which the range of grey values is determined."""
DEFECTIVE_PERCENT = 0.1
"""Percentage of the darkest and of the brightest pixels that are excluded from the range, as they may be defective."""


def read_grey(path: Path, size: tuple[int, int] | None = None, orientation: int | None = None) -> Image:
    """Returns the grey image (H, W), read-only, rotated by EXIF's `orientation` (see orientation.py), or by its own
    one.

    Raises UnreadableImage where it is missing, damaged, or not of `size` (width, height).
    """
    return _read(path, size, cv2.IMREAD_GRAYSCALE, orientation)


def read_image(path: Path, size: tuple[int, int] | None = None, orientation: int | None = None) -> Image:
    """Returns the same, in RGB (H, W, 3) if the file has colours."""
    return _read(path, size, cv2.IMREAD_ANYCOLOR, orientation)


def decode(
    content: bytes,
    where: str,
    size: tuple[int, int] | None = None,
    flag: int = cv2.IMREAD_ANYCOLOR,
    span: Callable[[], tuple[float, float]] | None = None,
    orientation: int | None = None,
) -> Image:
    """Returns the image (H, W) or RGB (H, W, 3) of a file's bytes, read-only.

    For values other than bytes, `span()` returns the values that become 0 and 255; by default 0 and the largest value
    of the type, which is 1 for floats. Raises UnreadableImage, which begins with `where`, for a damaged image, and for
    one that does not have `size`.
    """
    claimed = header_size(content, where)
    if claimed is None or not is_whole(content):
        raise UnreadableImage(f"{where} is not a whole image (truncated or damaged): restore it")
    _require(where, claimed, size, turned=True)
    flag |= 0 if orientation is None else cv2.IMREAD_IGNORE_ORIENTATION
    try:
        with silenced():
            image = cv2.imdecode(np.frombuffer(content, np.uint8), flag | cv2.IMREAD_ANYDEPTH)
    except cv2.error:
        image = None
    if image is None:
        raise UnreadableImage(f"{where} is not a whole image (truncated or damaged): restore it")
    image = image if orientation is None else oriented(np.asarray(image), orientation)
    _require(where, image.shape[1::-1], size)
    if image.dtype != np.uint8:
        image = as_bytes(image, None if span is None else span())
    image = np.asarray(image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
    image.setflags(write=False)
    return image


def as_bytes(image: NDArray[Any], span: tuple[float, float] | None) -> Image:
    """Converts values to bytes: those of `span` become 0 and 255, by default 0 and the largest value of the type (1 for
    floats)."""
    if span is None:
        span = 0.0, np.iinfo(image.dtype).max if np.issubdtype(image.dtype, np.integer) else 1.0
    black, white = span
    if black == 0 and np.issubdtype(image.dtype, np.integer):
        return np.clip(image // ((int(white) + 1) // 256), 0, 255).astype(np.uint8)
    scaled = np.nan_to_num((image - black) * (255.0 / (white - black)), nan=0.0, posinf=255.0, neginf=0.0)
    return np.clip(np.rint(scaled), 0, 255).astype(np.uint8)


@lru_cache(maxsize=64)
def span_of(folder: Path) -> tuple[float, float]:
    """Returns the values of black and white in a folder's images that are no bytes, from SAMPLED_IMAGES of them."""
    return span_of_values([values for values in map(_values, _samples(folder)) if values is not None])


def span_of_values(values: list[NDArray[Any]]) -> tuple[float, float]:
    """Returns the values of black and white in a recording, from the finite values of some images.

    These are 0, and the least of 1 (floats), 2^8 - 1, 2^10 - 1 ... 2^16 - 1 that none of the images exceeds, such as
    4095 for 12 bits. For thermal cameras, whose values are in a small range far from 0, it is twice that range. The
    values are the same for all images, so that their brightness can be compared.
    """
    values = [pixels for pixels in values if len(pixels)]
    if not values:
        return 0.0, 2.0**16 - 1
    highest = max(float(pixels.max()) for pixels in values)
    if highest <= 1.0 and any(np.issubdtype(pixels.dtype, np.floating) for pixels in values):
        return 0.0, 1.0
    ends = [np.percentile(pixels, (DEFECTIVE_PERCENT, 100 - DEFECTIVE_PERCENT)) for pixels in values]
    low, high = float(min(low for low, _ in ends)), float(max(high for _, high in ends))
    if high / 2 <= low < high:
        return low - (high - low) / 2, high + (high - low) / 2
    return 0.0, next((2.0**bits - 1 for bits in (8, 10, 12, 14) if highest < 2**bits), 2.0**16 - 1)


def sampled(count: int) -> list[int]:
    """Returns the indices of SAMPLED_IMAGES of `count` images."""
    return np.unique(np.linspace(0, count - 1, SAMPLED_IMAGES).round().astype(int)).tolist() if count else []


def _samples(folder: Path) -> list[Path]:
    paths = [folder / name for name in names(folder) if Path(name).suffix.lower() in IMAGE_SUFFIXES]
    return [paths[i] for i in sampled(len(paths))]


def _values(path: Path) -> NDArray[Any] | None:
    """Returns the finite values of an image; None where it holds bytes, or cannot be read."""
    try:
        return values_of(read_bytes(path, MAX_BYTES), str(path))
    except InputError:
        return None


def values_of(content: bytes, where: str) -> NDArray[Any] | None:
    """Returns the same of an image file's bytes."""
    try:
        claimed = header_size(content, where)
    except InputError:
        return None
    if claimed is None or claimed[0] * claimed[1] > MAX_PIXELS or not is_whole(content):
        return None
    with silenced():
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
    return None if image is None or image.dtype == np.uint8 else image[np.isfinite(image)]


def require_size(path: Path, size: tuple[int, int]) -> None:
    """Raises InputError where an image's header has another size than the camera; damaged images are reported when they
    are read."""
    try:
        content = read_bytes(path, MAX_BYTES)
    except InputError:
        return
    claimed = header_size(content, str(path))
    if claimed is not None:
        _require(str(path), claimed, size, turned=True)


def those_there(listing: Path, paths: list[Path]) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Returns the indices (N,) of the listed files that exist, and a note about the others. Raises InputError where
    none exists."""
    folders = {path.parent for path in paths}
    there = {folder: set(names(folder)) if os.path.isdir(folder) else set() for folder in folders}
    present = np.array([i for i, path in enumerate(paths) if path.name in there[path.parent]], np.int64)
    if not len(present):
        raise InputError(f"{paths[0]} is missing, as all images that {listing} lists: restore the images")
    missing = len(paths) - len(present)
    note = f"{missing} of {len(paths)} images that {listing} lists are missing: skipped."
    return present, (note,) if missing else ()


def _read(path: Path, size: tuple[int, int] | None, flag: int, orientation: int | None) -> Image:
    try:
        content = read_bytes(path, MAX_BYTES)
    except InputError as fault:
        raise UnreadableImage(fault.args[0]) from None
    return decode(content, str(path), size, flag, lambda: span_of(path.parent), orientation)


def _require(where: str, found: tuple[int, int], size: tuple[int, int] | None, turned: bool = False) -> None:
    """Raises UnreadableImage for another size. With `turned` the sides may be exchanged, as EXIF's orientation is not
    applied."""
    if size is None:
        if found[0] * found[1] > MAX_PIXELS:
            raise InputError(f"{where} is {found[0]} x {found[1]}, more than {MAX_PIXELS} px: give smaller images")
    elif found != size and not (turned and found[::-1] == size):
        cure = "restore the image, or correct the calibration"
        raise UnreadableImage(f"{where} is {found[0]} x {found[1]}, not {size[0]} x {size[1]} as its camera: {cure}")


def same_size(paths: list[Path]) -> tuple[list[str], str]:
    """Returns the names of a folder's images with the most frequent size, and a note about the others.

    The sizes are those of the files, before EXIF's orientation. In a large folder some images are read first; if these
    have one size, that of all others is assumed to be the same.
    """
    every = max(1, len(paths) // PHOTOS)
    sizes = {path: _size_of(path) for path in paths[::every]}
    if len(set(sizes.values()) - {None}) > 1:
        sizes = {path: sizes.get(path) or _size_of(path) for path in paths}
    counts = Counter(size for size in sizes.values() if size is not None)
    if len(counts) < 2:
        return [path.name for path in paths], ""
    (width, height), most = counts.most_common(1)[0]
    listed = ", ".join(f"{n} of {w} x {h}" for (w, h), n in counts.most_common()[1:])
    note = f"images of several sizes: the {most} of {width} x {height} are used, and {listed} are skipped"
    return [path.name for path in paths if sizes[path] in (None, (width, height))], note


def opacities(paths: list[Path]) -> list[NDArray[np.uint8]]:
    """Returns the opacity (H, W), 0 to 255, of SAMPLED_IMAGES of the images that have one; empty where some of them
    have none."""
    found = []
    for i in sampled(len(paths)):
        try:
            with opened(paths[i]) as file, Header.open(file, formats=FORMATS) as image:
                if image.mode not in ("RGBA", "LA", "PA") or image.width * image.height > MAX_PIXELS:
                    return []
                found.append(np.asarray(image.getchannel("A"), np.uint8))
        except (InputError, OSError, ValueError, SyntaxError, Header.DecompressionBombError):
            continue  # damaged images are reported when they are read
    return found


def _size_of(path: Path) -> tuple[int, int] | None:
    """Returns (width, height) of an image file by its header; None where it has none."""
    try:
        with opened(path) as file, Header.open(file, formats=FORMATS) as header:
            return header.size
    except (InputError, OSError, ValueError, SyntaxError, Header.DecompressionBombError):
        return None
