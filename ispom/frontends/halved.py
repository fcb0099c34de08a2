"""Large images at half their size: as good to search in, and four times as fast."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.types import Image

SEARCH_SIDE_PX = 700
"""Images whose longer side is longer are searched at half size."""


def halved(image: Image) -> Image:
    """At half its size where it is large, else as it is."""
    return np.asarray(cv2.pyrDown(image), np.uint8) if max(image.shape) > SEARCH_SIDE_PX else image


def factor_of(image: Image) -> int:
    """Pixels of an image per pixel of the halved one, along each side."""
    return 2 if max(image.shape) > SEARCH_SIDE_PX else 1
