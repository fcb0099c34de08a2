"""Reads size and completeness of an image file without decoding it."""

from __future__ import annotations

import re
import struct
from io import BytesIO

from PIL import Image as Header
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from ispom.errors import InputError
from ispom.io.camera import MAX_PIXELS

FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "PPM", "WEBP")
"""Formats that are recognised by their content, not by the file's name."""
MAX_BYTES = 8 * MAX_PIXELS
"""Largest size of an image file: eight bytes per pixel are four channels of 16 bits."""
_TIFF_STARTS = (b"II*\0", b"MM\0*")
_WIDTH, _HEIGHT, _BITS = 256, 257, 258
"""Tags of TIFF."""
_PNG_START, _PNG_SIGNATURE, _PNG_END = b"\x89PNG", b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
_MARKER = re.compile(rb"\xff+([^\x00\xff\xd0-\xd7])", re.DOTALL)
"""Markers of JPEG, except those within the compressed data: an escaped 255, and numbered restarts."""
_EOI, _ALONE = 0xD9, frozenset({0x01, 0xD8})
_TAIL_BYTES = 4096
"""Number of bytes that some cameras write after the end of a JPEG."""


def header_size(content: bytes, where: str) -> tuple[int, int] | None:
    """Returns (width, height) in the header of one of FORMATS; None for another file. Decodes nothing.

    Raises InputError, which begins with `where`, for hundreds of millions of pixels.
    """
    try:
        with Header.open(BytesIO(content), formats=FORMATS) as header:
            return header.size
    except Header.DecompressionBombError:
        raise InputError(f"{where} claims more pixels than any camera has: restore the image") from None
    except Exception:  # Pillow's parsers raise exceptions of any kind for damaged files
        return _tiff_size(content)


def is_whole(content: bytes) -> bool:
    """Checks that a file contains the end of its image; decoders return the upper part of a truncated file without
    error.

    The end may be followed by other data: the film of a motion photo, a second image (MPO), or zeros.
    """
    if content.startswith(_PNG_START):
        return content.rstrip(b"\0").endswith(_PNG_END) or _png_ends(content)
    if content.startswith(_JPEG_START):
        return _JPEG_END in content[2:][-_TAIL_BYTES:] or _jpeg_ends(content)
    return bool(content)


def _png_ends(content: bytes) -> bool:
    """Checks that the sequence of chunks reaches the last one."""
    at = len(_PNG_SIGNATURE)
    while at + 12 <= len(content):
        length, kind = struct.unpack_from(">I4s", content, at)
        if kind == b"IEND":
            return True
        at += 12 + length
    return False


def _jpeg_ends(content: bytes) -> bool:
    """Checks that the sequence of segments reaches the end of the image, not that of an embedded preview (ITU T.81,
    B)."""
    at = len(_JPEG_START)
    while (marker := _MARKER.search(content, at)) is not None:
        kind, at = marker[1][0], marker.end()
        if kind == _EOI:
            return True
        if kind not in _ALONE and at + 2 <= len(content):
            at += int.from_bytes(content[at : at + 2], "big")  # compressed data contains no other markers
    return False


def _tiff_size(content: bytes) -> tuple[int, int] | None:
    """Returns the size of a TIFF with pixels that OpenCV supports, but Pillow does not, such as colours in floats."""
    if not content.startswith(_TIFF_STARTS):
        return None
    try:
        tags, file = ImageFileDirectory_v2(content[:8]), BytesIO(content)
        file.seek(tags.next)
        tags.load(file)
        size = int(tags[_WIDTH]), int(tags[_HEIGHT])
        return size if size[0] * size[1] * sum(tags[_BITS]) <= 8 * MAX_BYTES else None
    except Exception:
        return None
