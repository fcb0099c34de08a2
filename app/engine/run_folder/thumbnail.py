"""A small picture of a run: what its camera saw half way."""

from __future__ import annotations

import cv2

from ispom.errors import InputError
from ispom.types import Sequence, StereoPair

WIDTH_PX, QUALITY = 160, 80


def thumbnail(sequence: Sequence, count: int) -> bytes | None:
    """JPEG of the frame in the middle of the first `count`; None where there is none, or it cannot be read."""
    if not count:
        return None
    try:
        exposure = sequence[(count - 1) // 2]
    except InputError:
        return None
    image = exposure.left if isinstance(exposure, StereoPair) else exposure.image
    height = max(round(image.shape[0] * WIDTH_PX / image.shape[1]), 1)
    small = cv2.resize(image, (WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    bgr = small if small.ndim == 2 else cv2.cvtColor(small, cv2.COLOR_RGB2BGR)
    return cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
