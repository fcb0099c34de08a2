"""Image files, read when asked for."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError, UnreadableImage
from ispom.types import Image

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp"})
_PNG_START, _PNG_END = b"\x89PNG", b"IEND\xaeB`\x82"
_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
_TAIL = 4096
"""Some cameras write this much behind the end of a JPEG."""


def read_grey(path: Path, size: tuple[int, int] | None = None) -> Image:
    """(H, W), read-only.

    UnreadableImage where it is missing or damaged, InputError where it is not of `size` (width, height).
    """
    return _read(path, size, cv2.IMREAD_GRAYSCALE)


def read_image(path: Path, size: tuple[int, int] | None = None) -> Image:
    """The same, (H, W, 3) RGB where the file has colours."""
    return _read(path, size, cv2.IMREAD_ANYCOLOR)


def decode(content: bytes, flag: int = cv2.IMREAD_ANYCOLOR) -> Image | None:
    """The image (H, W) or RGB (H, W, 3) of a file's bytes, read-only; None where it is not whole."""
    image = cv2.imdecode(np.frombuffer(content, np.uint8), flag) if _is_whole(content) else None
    if image is None:
        return None
    image = np.asarray(image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
    image.setflags(write=False)
    return image


def those_there(listing: Path, paths: list[Path]) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Indices (N,) of the listed files that are there, and what to tell of the others; InputError where none is."""
    names = {folder: _names(folder) for folder in {path.parent for path in paths}}
    found = np.array([i for i, path in enumerate(paths) if path.name in names[path.parent]], np.int64)
    if not len(found):
        raise InputError(f"{paths[0]} is missing, as all images that {listing} lists: restore the images")
    missing = len(paths) - len(found)
    note = f"{missing} of {len(paths)} images that {listing} lists are not there and are left out."
    return found, (note,) if missing else ()


def _names(folder: Path) -> set[str]:
    try:
        return set(os.listdir(folder))
    except (OSError, ValueError):
        return set()


def _read(path: Path, size: tuple[int, int] | None, flag: int) -> Image:
    try:
        content = path.read_bytes()
    except OSError:
        raise UnreadableImage(f"{path} is missing or unreadable: restore the image") from None
    image = decode(content, flag)
    if image is None:
        raise UnreadableImage(f"{path} is not a whole image (truncated or damaged): restore it")
    height, width = image.shape[:2]
    if size is not None and (width, height) != size:
        cure = "restore the image, or correct the calibration"
        raise InputError(f"{path} is {width} x {height}, not {size[0]} x {size[1]} as its camera: {cure}")
    return image


def _is_whole(content: bytes) -> bool:
    """Whether the end is there; checked before decoding, because decoders write about a cut file to standard error."""
    if content.startswith(_PNG_START):
        return content.rstrip(b"\0").endswith(_PNG_END)
    if content.startswith(_JPEG_START):
        return _JPEG_END in content[2:][-_TAIL:]
    return bool(content)
