"""Corners worth tracking (Shi & Tomasi 1994), spread over the image."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.frontends.halved import factor_of, halved
from ispom.types import Image


def detect(
    grey: Image,
    count: int,
    taken: NDArray[np.float32] | None = None,
    min_distance_px: float = 8.0,
    border_px: int = 8,
) -> NDArray[np.float32]:
    """Up to `count` new corners (M, 2) [px], strongest first, away from those `taken` (N, 2) and from the border."""
    if count <= 0:
        return np.zeros((0, 2), np.float32)
    factor, searched = factor_of(grey), halved(grey)
    mask = np.zeros(searched.shape, np.uint8)
    border = border_px // factor
    mask[border:-border, border:-border] = 255
    if taken is not None:
        _exclude(mask, np.rint(taken / factor).astype(np.int64), round(min_distance_px / factor))
    found = cv2.goodFeaturesToTrack(searched, count, 0.005, min_distance_px / factor, mask=mask, blockSize=5)
    if found is None or not len(found):
        return np.zeros((0, 2), np.float32)
    return at_subpixel(grey, np.asarray(factor * found.reshape(-1, 2), np.float32), 3, 5)


def _exclude(mask: Image, places: NDArray[np.int64], radius: int) -> None:
    """Zeros in the mask on disks around places (N, 2); its border is 0 anyway."""
    down, right = np.nonzero(cv2.circle(np.zeros((2 * radius + 1,) * 2, np.uint8), (radius, radius), radius, 1, -1))
    row = np.clip(places[:, 1:] + (down - radius), 0, mask.shape[0] - 1)
    column = np.clip(places[:, :1] + (right - radius), 0, mask.shape[1] - 1)
    mask[row, column] = 0


def at_subpixel(grey: Image, uv: NDArray[np.float32], radius_px: int, iterations: int) -> NDArray[np.float32]:
    """(M, 2) where the edges about each place (M, 2) meet (Foerstner & Guelch 1987): a point that is not on its corner
    does not stay on the scene as the camera turns about its axis."""
    start = np.array(uv, np.float32).reshape(-1, 1, 2)
    if not len(start):
        return start.reshape(-1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT, iterations, 0.01)
    exact = cv2.cornerSubPix(grey, start, (radius_px, radius_px), (-1, -1), criteria)
    return np.asarray(exact, np.float32).reshape(-1, 2)
