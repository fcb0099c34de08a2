"""SUSAN corners (Smith and Brady 1997): pixels of which few in a circular mask are as bright as the one in its centre.

The area of similar pixels (USAN) is all of the mask on a plain surface, half of it on an edge, and a quarter at a right
angle. No derivatives are taken, so that noise is not amplified. A corner is where

1. the USAN is smaller than half of the mask (section 4: the geometric threshold);
2. its centroid is away from the centre: else it is a thin line or a speck of noise;
3. all pixels from the centre towards the centroid belong to it (contiguity);
4. no pixel around has a smaller USAN.

Corners are found to the pixel, not to a part of it, and fewer of them where edges are blurred.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.features.images import factor_of, halved
from ispom.features.patches import RADIUS_PX
from ispom.features.shi_tomasi import spread_peaks
from ispom.geometry import Array
from ispom.types import Image

HALF_WIDTHS = {-3: 1, -2: 2, -1: 3, 0: 3, 1: 3, 2: 2, 3: 1}
"""Half width of the mask of 37 pixels by row: a digital circle with a radius of 3.4 px."""
OFFSETS = np.array([(dx, dy) for dy, half in HALF_WIDTHS.items() for dx in range(-half, half + 1)])
"""(37, 2) of the mask's pixels from its centre [px]."""
MASK_RADIUS_PX = 3
"""Largest offset of the pixels of the paper's mask."""
BRIGHTNESS = 20.0
"""Brightness difference t [grey levels] at which similarity has fallen to 1/e: the paper's value for common images."""
MAX_USAN = 0.5
"""Largest USAN of a corner, as a share of the mask: the geometric threshold of the paper, section 4."""
MIN_CENTROID_PX = np.sqrt(0.5)
"""Least distance of the USAN's centroid from the centre; that of a straight edge has 1.4 px, a line's 0."""
MIN_CONTIGUITY = 0.97
"""Least mean similarity of the pixels between centre and centroid: all are similar, apart from noise."""
BORDER_PX = 8
"""Least distance of a corner from the image's border."""


@dataclass(frozen=True)
class Susan:
    """A Detector of SUSAN corners, spread evenly over the image."""

    brightness: float = BRIGHTNESS
    """The brightness threshold t [grey levels]."""

    def detect(
        self, grey: Image, count: int, occupied: NDArray[np.float32], min_distance_px: float
    ) -> NDArray[np.float32]:
        """See interfaces.Detector. Large images are searched at half size, as for Shi-Tomasi corners."""
        factor, searched = factor_of(grey), halved(grey)
        if min(searched.shape) <= 2 * MASK_RADIUS_PX:
            return np.zeros((0, 2), np.float32)
        return factor * spread_peaks(
            searched, response(searched, self.brightness), 0.0, count, np.asarray(occupied, np.float64) / factor,
            min_distance_px / factor, max(BORDER_PX // factor, MASK_RADIUS_PX), RADIUS_PX // factor,
        )  # fmt: skip


def response(grey: Image, brightness: float = BRIGHTNESS) -> NDArray[np.float32]:
    """Returns by how many pixels the USAN of each pixel is smaller than the threshold (H, W); 0 where no corner is."""
    difference = np.arange(256) / brightness
    table = np.exp(-(difference**6)).astype(np.float32)  # equation 4
    area, x, y = (np.zeros(grey.shape, np.float32) for _ in range(3))
    for dx, dy in OFFSETS.tolist():
        similar = cv2.LUT(cv2.absdiff(_moved(grey, dx, dy), grey), table)
        area += similar
        x += np.float32(dx) * similar
        y += np.float32(dy) * similar
    found = np.maximum(np.float32(MAX_USAN * len(OFFSETS)) - area, np.float32(0))  # equation 3
    found[x**2 + y**2 < (MIN_CENTROID_PX * area) ** 2] = 0
    row, column = np.nonzero(found)
    direction = np.stack([x[row, column], y[row, column]], axis=1).astype(float)
    direction /= np.abs(direction).max(axis=1, keepdims=True).clip(1e-9)
    between = np.zeros(len(row))
    for step in range(1, MASK_RADIUS_PX + 1):
        between += table[_difference(grey, row, column, step * direction)] / MASK_RADIUS_PX
    broken = between < MIN_CONTIGUITY
    found[row[broken], column[broken]] = 0
    return found


def _moved(grey: Image, dx: int, dy: int) -> Image:
    """Returns the image whose pixels are those at an offset of up to MASK_RADIUS_PX; at the border, the last ones."""
    padded = np.pad(grey, MASK_RADIUS_PX, mode="edge")
    height, width = grey.shape
    return padded[MASK_RADIUS_PX + dy : MASK_RADIUS_PX + dy + height, MASK_RADIUS_PX + dx : MASK_RADIUS_PX + dx + width]


def _difference(grey: Image, row: NDArray[np.int64], column: NDArray[np.int64], offset: Array) -> NDArray[np.int64]:
    """Returns how much pixels (N,) differ from those at offsets (N, 2) [px] from them."""
    there = np.rint(offset).astype(int) + np.stack([column, row], axis=1)
    u, v = np.clip(there, 0, np.array(grey.shape[::-1]) - 1).T
    return np.abs(grey[v, u].astype(int) - grey[row, column])
