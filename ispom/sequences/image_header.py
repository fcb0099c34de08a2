"""What an image file says about itself before anything of it is decoded."""

from __future__ import annotations

import re
import struct
from io import BytesIO

from PIL import Image as Header
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from ispom.errors import InputError
from ispom.io.camera import MAX_PIXELS

FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "PPM", "WEBP")
"""By content, whatever the name says."""
MAX_BYTES = 8 * MAX_PIXELS
_TIFF_STARTS = (b"II*\0", b"MM\0*")
_WIDTH, _HEIGHT, _BITS = 256, 257, 258
"""Tags of TIFF."""
_PNG_START, _PNG_SIGNATURE, _PNG_END = b"\x89PNG", b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
_MARKER = re.compile(rb"\xff+([^\x00\xff\xd0-\xd7])", re.DOTALL)
"""Of JPEG: none of those within an image's own bytes, where 0 follows 255 and restarts are numbered."""
_EOI, _ALONE = 0xD9, frozenset({0x01, 0xD8})
_TAIL = 4096
"""Some cameras write this much behind the end of a JPEG."""


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
        return _tiff_size(content)


def is_whole(content: bytes) -> bool:
    """Whether the end of the image is there; decoders give a cut file's upper part as if it were the whole.

    Behind that end anything may follow: the film of a motion photo, a second image (MPO), or zeros.
    """
    if content.startswith(_PNG_START):
        return content.rstrip(b"\0").endswith(_PNG_END) or _png_ends(content)
    if content.startswith(_JPEG_START):
        return _JPEG_END in content[2:][-_TAIL:] or _jpeg_ends(content)
    return bool(content)


def _png_ends(content: bytes) -> bool:
    """Whether its chunks lead to the last one."""
    at = len(_PNG_SIGNATURE)
    while at + 12 <= len(content):
        length, kind = struct.unpack_from(">I4s", content, at)
        if kind == b"IEND":
            return True
        at += 12 + length
    return False


def _jpeg_ends(content: bytes) -> bool:
    """Whether its segments lead to the end of the image; those of a preview in them do not count (ITU T.81, B)."""
    at = len(_JPEG_START)
    while (marker := _MARKER.search(content, at)) is not None:
        kind, at = marker[1][0], marker.end()
        if kind == _EOI:
            return True
        if kind not in _ALONE and at + 2 <= len(content):
            at += int.from_bytes(content[at : at + 2], "big")  # the image's own bytes hold no marker but these
    return False


def _tiff_size(content: bytes) -> tuple[int, int] | None:
    """The same of a TIFF whose kind of pixel, such as colours in floats, Pillow does not know and OpenCV does."""
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
