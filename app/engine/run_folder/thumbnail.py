"""Images as JPEG, and the thumbnail of a run: the image in its middle."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.errors import InputError
from ispom.types import Image, Sequence, main_image

WIDTH_PX, QUALITY = 160, 80


def thumbnail(sequence: Sequence, count: int) -> bytes | None:
    """JPEG of the frame in the middle of the first `count`; None where there is none, or it cannot be read."""
    drawn = [i for i, kind in enumerate(sequence.kinds[:count]) if kind in ("video", "stereo")]
    if not drawn:
        return None
    middle = min(drawn, key=lambda i: abs(2 * i - (count - 1)))
    try:
        shown = main_image(sequence[middle])
    except InputError:
        return None
    return None if shown is None else jpeg(shown[1], QUALITY, WIDTH_PX)


def jpeg(image: Image, quality: int, most_px: int | None = None) -> bytes:
    """Returns the JPEG of an image, grey or RGB, reduced to at most `most_px` pixels of width."""
    if most_px is not None and image.shape[1] > most_px:
        size = (most_px, max(1, round(image.shape[0] * most_px / image.shape[1])))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    bgr = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    return cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
