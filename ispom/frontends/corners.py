"""Corners worth tracking (Shi & Tomasi 1994), spread over the image."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.types import Image

SEARCH_WIDTH_PX = 700
"""Wider images are searched at half size: as good to track, and four times as fast."""


def detect(
    grey: Image, count: int, taken: NDArray[np.float32] | None = None, min_distance_px: float = 8.0, border_px: int = 8
) -> NDArray[np.float32]:
    """Up to `count` new corners (M, 2) [px], strongest first, away from those `taken` (N, 2) and from the border."""
    if count <= 0:
        return np.zeros((0, 2), np.float32)
    factor = 2 if grey.shape[1] > SEARCH_WIDTH_PX else 1
    searched = grey if factor == 1 else cv2.pyrDown(grey)
    mask = np.zeros(searched.shape, np.uint8)
    border = border_px // factor
    mask[border:-border, border:-border] = 255
    if taken is not None:
        for u, v in np.rint(taken / factor).astype(int).tolist():
            cv2.circle(mask, (u, v), round(min_distance_px / factor), 0, -1)
    found = cv2.goodFeaturesToTrack(searched, count, 0.005, min_distance_px / factor, mask=mask, blockSize=5)
    if found is None or not len(found):
        return np.zeros((0, 2), np.float32)
    start = np.ascontiguousarray(factor * found.reshape(-1, 1, 2))
    refined = cv2.cornerSubPix(grey, start, (3, 3), (-1, -1), (cv2.TERM_CRITERIA_COUNT, 5, 0.01))
    return np.asarray(refined, np.float32).reshape(-1, 2)
