"""Image files, read when requested. The header is read first: what it claims is decoded only where it is expected."""

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
from ispom.sequences.orientation import SAMPLES as PHOTOS
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
"""Of images in formats that are not read."""
SAMPLES = 8
"""Images of a folder that determine the range of all."""
DEFECTIVE = 0.1
"""Per cent of the pixels at either end that may be defective, and are no part of that range."""


def read_grey(path: Path, size: tuple[int, int] | None = None, orientation: int | None = None) -> Image:
    """(H, W), read-only; turned by EXIF's `orientation` (see orientation.py), or else by the image's own.

    UnreadableImage where it is missing, damaged, or not of `size` (width, height).
    """
    return _read(path, size, cv2.IMREAD_GRAYSCALE, orientation)


def read_image(path: Path, size: tuple[int, int] | None = None, orientation: int | None = None) -> Image:
    """The same, (H, W, 3) RGB where the file has colours."""
    return _read(path, size, cv2.IMREAD_ANYCOLOR, orientation)


def decode(
    content: bytes,
    where: str,
    size: tuple[int, int] | None = None,
    flag: int = cv2.IMREAD_ANYCOLOR,
    span: Callable[[], tuple[float, float]] | None = None,
    orientation: int | None = None,
) -> Image:
    """The image (H, W) or RGB (H, W, 3) of a file's bytes, read-only.

    Where its values are no bytes, `span()` is what becomes 0 and 255; without it, 0 and the largest value of their kind
    do, or of floats 1. UnreadableImage, beginning with `where`, where it is not whole, or not of `size`.
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
    """With `span` as 0 and 255; without it, 0 and the largest value of their kind, or of floats 1."""
    if span is None:
        span = 0.0, np.iinfo(image.dtype).max if np.issubdtype(image.dtype, np.integer) else 1.0
    black, white = span
    if black == 0 and np.issubdtype(image.dtype, np.integer):
        return np.clip(image // ((int(white) + 1) // 256), 0, 255).astype(np.uint8)
    scaled = np.nan_to_num((image - black) * (255.0 / (white - black)), nan=0.0, posinf=255.0, neginf=0.0)
    return np.clip(np.rint(scaled), 0, 255).astype(np.uint8)


@lru_cache(maxsize=64)
def span_of(folder: Path) -> tuple[float, float]:
    """What is black and white in the images of a folder, where they are no bytes, from SAMPLES of them."""
    return span_of_values([values for values in map(_values, _samples(folder)) if values is not None])


def span_of_values(values: list[NDArray[Any]]) -> tuple[float, float]:
    """What is black and white in images of a recording, by the finite values of some: of 12-bit ones 0 and 4095.

    Of several images, as one may be a dark one: 0, and the least of 1 (floats) and of 2^8, 2^10 ... 2^16 less one that
    none of them exceeds. Of thermal cameras, whose values lie in a small part of that and far from 0, twice that part.
    The same for all its images, so that their brightness can be compared.
    """
    values = [pixels for pixels in values if len(pixels)]
    if not values:
        return 0.0, 2.0**16 - 1
    highest = max(float(pixels.max()) for pixels in values)
    if highest <= 1.0 and any(np.issubdtype(pixels.dtype, np.floating) for pixels in values):
        return 0.0, 1.0
    ends = [np.percentile(pixels, (DEFECTIVE, 100 - DEFECTIVE)) for pixels in values]
    low, high = float(min(low for low, _ in ends)), float(max(high for _, high in ends))
    if high / 2 <= low < high:
        return low - (high - low) / 2, high + (high - low) / 2
    return 0.0, next((2.0**bits - 1 for bits in (8, 10, 12, 14) if highest < 2**bits), 2.0**16 - 1)


def sampled(count: int) -> list[int]:
    """Indices of SAMPLES of so many images."""
    return np.unique(np.linspace(0, count - 1, SAMPLES).round().astype(int)).tolist() if count else []


def _samples(folder: Path) -> list[Path]:
    paths = [folder / name for name in names(folder) if Path(name).suffix.lower() in IMAGE_SUFFIXES]
    return [paths[i] for i in sampled(len(paths))]


def _values(path: Path) -> NDArray[Any] | None:
    """The finite values of an image; None where it holds bytes, or cannot be read."""
    try:
        return values_of(read_bytes(path, MAX_BYTES), str(path))
    except InputError:
        return None


def values_of(content: bytes, where: str) -> NDArray[Any] | None:
    """The same of an image file's bytes."""
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
    """InputError where an image's header has another size than the camera; a damaged one is found when it is read."""
    try:
        content = read_bytes(path, MAX_BYTES)
    except InputError:
        return
    claimed = header_size(content, str(path))
    if claimed is not None:
        _require(str(path), claimed, size, turned=True)


def those_there(listing: Path, paths: list[Path]) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Indices (N,) of the listed files that are there, and a note about the others; InputError where none is."""
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
    """`turned`: sides may be exchanged, where EXIF's orientation is not yet applied."""
    if size is None:
        if found[0] * found[1] > MAX_PIXELS:
            raise InputError(f"{where} is {found[0]} x {found[1]}, more than {MAX_PIXELS} px: give smaller images")
    elif found != size and not (turned and found[::-1] == size):
        cure = "restore the image, or correct the calibration"
        raise UnreadableImage(f"{where} is {found[0]} x {found[1]}, not {size[0]} x {size[1]} as its camera: {cure}")


def same_size(paths: list[Path]) -> tuple[list[str], str]:
    """The names of a folder's images that have the size that most of them have, and a note about the others.

    The sizes are those of the files, before EXIF's orientation. Of a large folder some images are read first: where
    they are all of one size, so is the folder.
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
    """The opacity (H, W), 0 to 255, of SAMPLES of the images that have one; empty where some of them have none."""
    found = []
    for i in sampled(len(paths)):
        try:
            with opened(paths[i]) as file, Header.open(file, formats=FORMATS) as image:
                if image.mode not in ("RGBA", "LA", "PA") or image.width * image.height > MAX_PIXELS:
                    return []
                found.append(np.asarray(image.getchannel("A"), np.uint8))
        except (InputError, OSError, ValueError, SyntaxError, Header.DecompressionBombError):
            continue  # a damaged one is found when it is read
    return found


def _size_of(path: Path) -> tuple[int, int] | None:
    """(width, height) of an image file by its header; None where it has none."""
    try:
        with opened(path) as file, Header.open(file, formats=FORMATS) as header:
            return header.size
    except (InputError, OSError, ValueError, SyntaxError, Header.DecompressionBombError):
        return None
