"""Whether an image shows anything: a dark or covered lens has noise, but no contrast."""

from __future__ import annotations

import cv2

from ispom.types import Image

MIN_CONTRAST = 0.2
"""Deviation of the coarse image's grey values, over that of the last good one: with less it shows nothing."""
COARSE = 8
"""Pixels of the image per pixel of the coarse one: averages of 64 have an eighth of the noise."""


def has_contrast(grey: Image, other: Image | None) -> bool:
    """Whether the image has contrast beyond its noise, compared with another one."""
    if other is None:
        return True
    now, before = (
        float(cv2.resize(g, None, fx=1 / COARSE, fy=1 / COARSE, interpolation=cv2.INTER_AREA).std())
        for g in (grey, other)
    )
    return now > MIN_CONTRAST * before
