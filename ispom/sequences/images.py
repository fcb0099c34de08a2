"""Image files, read when asked for."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ispom.errors import InputError
from ispom.types import Image

_PNG_START, _PNG_END = b"\x89PNG", b"IEND\xaeB`\x82"


def read_grey(path: Path, size: tuple[int, int] | None = None) -> Image:
    """(H, W), read-only; InputError where it is missing, damaged, or not of `size` (width, height)."""
    try:
        content = path.read_bytes()
    except OSError:
        raise InputError(f"{path} is missing or unreadable: restore the image") from None
    # Checked before decoding, because the decoder writes about a cut file to standard error.
    whole = not content.startswith(_PNG_START) or content.rstrip(b"\0").endswith(_PNG_END)
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE) if whole and content else None
    if image is None:
        raise InputError(f"{path} is not a whole image (truncated or damaged): restore it")
    height, width = image.shape
    if size is not None and (width, height) != size:
        raise InputError(f"{path} is {width} x {height}, the first image {size[0]} x {size[1]}: restore the image")
    image.setflags(write=False)
    return np.asarray(image, np.uint8)
