"""Where an image shows more than its own noise."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.kernels import part
from ispom.types import Image

BLOCK_PX = 16
"""Side of the blocks in which noise is looked for."""
FLAT = 0.25
"""Share of the blocks that are taken to show little else."""
SECOND = np.array([1.0, -2.0, 1.0], np.float32)


def grey_noise(image: Image) -> float:
    """Standard deviation of an image's noise from pixel to pixel [grey levels], where it shows least else; 0 of what is
    too small to tell.

    By differences of second order across and down, which even shading and straight edges leave nothing of (Immerkaer
    1996).
    """
    across, down = image.shape[1] // BLOCK_PX, image.shape[0] // BLOCK_PX
    if not across or not down:
        return 0.0
    left = np.abs(cv2.sepFilter2D(image, cv2.CV_32F, SECOND, SECOND))
    means = cv2.resize(left, (across, down), interpolation=cv2.INTER_AREA)
    return float(np.sqrt(np.pi / 2) * np.quantile(means, FLAT) / (SECOND @ SECOND))


@part
def texture(image, column, row, radius):
    """Of a square around a pixel, how much grey values change in the direction in which they do least.

    The smaller eigenvalue of the sum of their gradients' squares [(grey levels per pixel)^2] (Shi & Tomasi 1994), whose
    mean tells nothing of the place where the brightness may differ. Of noise alone half its variance a pixel. 0 where
    the square reaches out of the image.
    """
    reach = radius + 1
    if not (reach <= column < image.shape[1] - reach and reach <= row < image.shape[0] - reach):
        return 0.0
    a, b, xx, xy, yy, n = 0.0, 0.0, 0.0, 0.0, 0.0, (2 * radius + 1) ** 2
    for i in range(row - radius, row + radius + 1):
        for j in range(column - radius, column + radius + 1):
            gx = 0.5 * (np.float64(image[i, j + 1]) - np.float64(image[i, j - 1]))
            gy = 0.5 * (np.float64(image[i + 1, j]) - np.float64(image[i - 1, j]))
            a += gx
            b += gy
            xx += gx * gx
            xy += gx * gy
            yy += gy * gy
    xx, xy, yy = xx - a * a / n, xy - a * b / n, yy - b * b / n
    return 0.5 * (xx + yy) - np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
