"""Image files, read when asked for. The header is read first: what it claims is decoded only where it is expected."""

from __future__ import annotations

import os
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Header

from ispom.errors import InputError, UnreadableImage
from ispom.io.camera import MAX_PIXELS
from ispom.io.files import names, read_bytes
from ispom.sequences.decoder_output import silenced
from ispom.types import Image

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp"})
FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "PPM", "WEBP")
"""By content, whatever the name says."""
MAX_BYTES = 8 * MAX_PIXELS
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


def decode(content: bytes, where: str, size: tuple[int, int] | None = None, flag: int = cv2.IMREAD_ANYCOLOR) -> Image:
    """The image (H, W) or RGB (H, W, 3) of a file's bytes, read-only.

    UnreadableImage, beginning with `where`, where it is not whole, InputError where it is not of `size`.
    """
    claimed = header_size(content, where)
    if claimed is None or not _is_whole(content):
        raise UnreadableImage(f"{where} is not a whole image (truncated or damaged): restore it")
    _require(where, claimed, size, turned=True)
    try:
        with silenced():
            image = cv2.imdecode(np.frombuffer(content, np.uint8), flag)
    except cv2.error:
        image = None
    if image is None:
        raise UnreadableImage(f"{where} is not a whole image (truncated or damaged): restore it")
    _require(where, image.shape[1::-1], size)
    image = np.asarray(image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
    image.setflags(write=False)
    return image


def header_size(content: bytes, where: str) -> tuple[int, int] | None:
    """(width, height) that the header of one of FORMATS claims; None where there is none. Decodes nothing.

    InputError, beginning with `where`, where it claims hundreds of millions of pixels.
    """
    try:
        with Header.open(BytesIO(content), formats=FORMATS) as header:
            return header.size
    except Header.DecompressionBombError:
        raise InputError(f"{where} claims more pixels than any camera has: restore the image") from None
    except Exception:  # its parsers raise whatever the damage leads to
        return None


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
    found = np.array([i for i, path in enumerate(paths) if path.name in there[path.parent]], np.int64)
    if not len(found):
        raise InputError(f"{paths[0]} is missing, as all images that {listing} lists: restore the images")
    missing = len(paths) - len(found)
    note = f"{missing} of {len(paths)} images that {listing} lists are missing: skipped."
    return found, (note,) if missing else ()


def _read(path: Path, size: tuple[int, int] | None, flag: int) -> Image:
    try:
        content = read_bytes(path, MAX_BYTES)
    except InputError as fault:
        raise UnreadableImage(fault.args[0]) from None
    return decode(content, str(path), size, flag)


def _require(where: str, found: tuple[int, int], size: tuple[int, int] | None, turned: bool = False) -> None:
    """`turned`: sides may be exchanged, where EXIF's orientation is not yet applied."""
    if size is None:
        if found[0] * found[1] > MAX_PIXELS:
            raise InputError(f"{where} is {found[0]} x {found[1]}, more than {MAX_PIXELS} px: give smaller images")
    elif found != size and not (turned and found[::-1] == size):
        cure = "restore the image, or correct the calibration"
        raise InputError(f"{where} is {found[0]} x {found[1]}, not {size[0]} x {size[1]} as its camera: {cure}")


def _is_whole(content: bytes) -> bool:
    """Whether the end is there; decoders give a cut file's upper part as if it were the whole."""
    if content.startswith(_PNG_START):
        return content.rstrip(b"\0").endswith(_PNG_END)
    if content.startswith(_JPEG_START):
        return _JPEG_END in content[2:][-_TAIL:]
    return bool(content)
