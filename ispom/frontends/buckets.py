"""Corners spread over the image: the strongest of each bucket, where too few are tracked (Shi & Tomasi 1994)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.frontends.halved import factor_of, halved
from ispom.frontends.patches import RADIUS_PX
from ispom.frontends.texture import grey_noise, texture
from ispom.kernels import kernel, read_only
from ispom.types import Image

QUALITY = 0.002
"""Corners weaker than this share of a strong one in the image are not used."""
NOISE = 5.0
"""Nor are those whose patch has less texture, as a multiple of what noise alone would show, where the image has far
better: noise would put it off by 0.08 px, as much as tracks are off by; and on clouds and bare walls it slides to where
it is expected."""
FAINT = 0.01
"""So much less, as a share of a strong patch: in the dark all are faint, and have to do."""
STRONGEST = 16
"""Places that tell what is strong in an image."""


def detect_spread(
    grey: Image,
    count: int,
    taken: NDArray[np.float32],
    min_distance_px: float,
    border_px: int = 8,
    crowd: float = 1.0,
    half: Image | None = None,
) -> NDArray[np.float32]:
    """New corners (M, 2) [px], so that with those `taken` (N, 2) no bucket holds more than `crowd` times its share of
    `count`: all about as many at 1, the strongest wherever they are where it is large.

    Buckets are about square; no corner is nearer than `min_distance_px` to another one or to one taken. `half`: the
    halved image, where it is there already.
    """
    factor, searched = factor_of(grey), halved(grey) if half is None else half
    height, width = searched.shape
    border_px, min_distance_px = border_px // factor, min_distance_px / factor
    score = cv2.cornerMinEigenVal(searched, 3, ksize=3)
    peak = score >= cv2.dilate(score, np.ones((3, 3), np.uint8))
    peak[:border_px], peak[-border_px:], peak[:, :border_px], peak[:, -border_px:] = False, False, False, False
    some = score[::4, ::4].ravel()
    strong = float(np.partition(some, -STRONGEST)[-STRONGEST] if score.size > 1000 else score.max())
    row, column = np.nonzero(peak & (score > max(QUALITY * strong, 1e-7)))
    if not len(row):
        return np.zeros((0, 2), np.float32)
    side = np.sqrt(width * height / max(count / 5, 1))
    across, down = max(1, round(width / side)), max(1, round(height / side))
    order = np.argsort(-score[row, column], kind="stable")
    radius = RADIUS_PX // factor
    noise = 0.5 * (grey_noise(searched) * (2 * radius + 1)) ** 2
    return factor * _select(
        read_only(searched), radius, noise, column[order], row[order],
        np.asarray(taken, np.float64) / factor, width, height, across, down,
        int(np.ceil(crowd * count / (across * down))), count - len(taken), min_distance_px,
    )  # fmt: skip


@kernel()
def _select(image, radius, noise, column, row, taken, width, height, across, down, per_bucket, count, min_distance):
    """Greedy, strongest first; a coarse grid of taken places keeps the distance test local."""
    cell = max(min_distance, 1.0)
    n_columns, n_rows = int(width / cell) + 1, int(height / cell) + 1
    grid = np.full((n_rows, n_columns, 2), -1e9)
    filled = np.zeros((down, across), np.int64)
    for i in range(len(taken)):
        u, v = min(max(taken[i, 0], 0.0), width - 1.0), min(max(taken[i, 1], 0.0), height - 1.0)
        grid[int(v / cell), int(u / cell), 0], grid[int(v / cell), int(u / cell), 1] = u, v
        filled[int(v * down / height), int(u * across / width)] += 1
    out = np.empty((max(count, 0), 2), np.float32)
    n, strong = 0, 0.0
    for i in range(min(len(row), STRONGEST)):
        strong = max(strong, texture(image, column[i], row[i], radius))
    least = min(NOISE * noise, noise + FAINT * strong)
    for i in range(len(row)):
        if n >= count:
            break
        u, v = float(column[i]), float(row[i])
        b, a = int(v * down / height), int(u * across / width)
        if filled[b, a] >= per_bucket:
            continue
        gy, gx, free = int(v / cell), int(u / cell), True
        for y in range(max(gy - 1, 0), min(gy + 2, n_rows)):
            for x in range(max(gx - 1, 0), min(gx + 2, n_columns)):
                du, dv = grid[y, x, 0] - u, grid[y, x, 1] - v
                if du * du + dv * dv < min_distance * min_distance:
                    free = False
        if not free or texture(image, column[i], row[i], radius) < least:
            continue
        grid[gy, gx, 0], grid[gy, gx, 1] = u, v
        filled[b, a] += 1
        out[n, 0], out[n, 1] = u, v
        n += 1
    return out[:n]
