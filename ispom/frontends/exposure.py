"""Exposure changes from image to image, undone: tracking compares grey levels."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.types import Image

MIN_GAIN, MIN_OFFSET, MAX_GAIN = 0.08, 8.0, 3.0
"""Changes of contrast and brightness [grey levels] that tracking wants undone; more is another image, not exposure."""


def as_bright(grey: Image, other: Image) -> Image:
    """`grey` with the mean and contrast of `other`, where the exposure changed between them; else as it is."""
    (mean,), (spread,) = (np.ravel(v) for v in cv2.meanStdDev(grey))
    (wanted,), (wanted_spread,) = (np.ravel(v) for v in cv2.meanStdDev(other))
    gain = float(wanted_spread) / max(float(spread), 1.0)
    if (abs(gain - 1) < MIN_GAIN and abs(wanted - mean) < MIN_OFFSET) or not 1 / MAX_GAIN < gain < MAX_GAIN:
        return grey
    table = np.clip((np.arange(256) - float(mean)) * gain + float(wanted) + 0.5, 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(grey, table), np.uint8)
