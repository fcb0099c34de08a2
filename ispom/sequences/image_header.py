"""What an image file says about itself before anything of it is decoded."""

from __future__ import annotations

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
_PNG_START, _PNG_END = b"\x89PNG", b"IEND\xaeB`\x82"
_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
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
    """Whether the end is there; decoders give a cut file's upper part as if it were the whole."""
    if content.startswith(_PNG_START):
        return content.rstrip(b"\0").endswith(_PNG_END)
    if content.startswith(_JPEG_START):
        return _JPEG_END in content[2:][-_TAIL:]
    return bool(content)


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
