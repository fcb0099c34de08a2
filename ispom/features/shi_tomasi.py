"""Corners worth tracking (Shi & Tomasi 1994): the strongest ones, or those of an even spread over the image."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.features.images import factor_of, halved
from ispom.features.patches import RADIUS_PX
from ispom.geometry import Array
from ispom.kernels import kernel, part, read_only
from ispom.types import Image

MIN_QUALITY = 0.002
"""Least score of a corner, relative to that of a strong one in the image."""
MIN_TEXTURE_TO_NOISE = 5.0
"""Least texture of a corner's patch, as a multiple of that of noise alone, unless the whole image is faint. With this
ratio, noise moves a corner by 0.08 px, the size of the errors of tracks; on clouds and bare walls, tracks slide towards
their prediction."""
MIN_FAINT_QUALITY = 0.01
"""Texture in excess of noise, relative to that of a strong patch, that is always enough: in the dark all patches are
faint."""
STRONG_CORNERS = 16
"""Number of corners by which the score of a strong one is determined."""
NOISE_BLOCK_PX = 16
"""Side of the blocks in which noise is measured."""
FLAT_SHARE = 0.25
"""Share of the blocks that are assumed to show noise only."""
SECOND_DIFFERENCE = np.array([1.0, -2.0, 1.0], np.float32)


@dataclass(frozen=True)
class ShiTomasi:
    """A Detector, see `detect_spread` and `detect_corners`."""

    spread: bool = True
    """Whether corners are spread over the image; else the strongest ones are detected, anywhere in the image."""
    crowd: float = 1.0
    """Most corners in a part of the image, relative to an equal share, where they are spread."""

    def detect(
        self, grey: Image, count: int, occupied: NDArray[np.float32], min_distance_px: float
    ) -> NDArray[np.float32]:
        """See interfaces.Detector."""
        if not grey.size:
            return np.zeros((0, 2), np.float32)
        if self.spread:
            return detect_spread(grey, count, occupied, min_distance_px, crowd=self.crowd)
        return detect_corners(grey, count - len(occupied), occupied, min_distance_px)


def detect_spread(
    grey: Image,
    count: int,
    taken: NDArray[np.float32],
    min_distance_px: float,
    border_px: int = 8,
    crowd: float = 1.0,
) -> NDArray[np.float32]:
    """New corners (M, 2) [px], so that with those `taken` (N, 2) no bucket holds more than `crowd` times its share of
    `count`: all about as many at 1, the strongest wherever they are where it is large.

    Buckets are about square; no corner is nearer than `min_distance_px` to another one or to a taken one.
    """
    factor, searched = factor_of(grey), halved(grey)
    score = np.asarray(cv2.cornerMinEigenVal(searched, 3, ksize=3), np.float32)
    return factor * spread_peaks(
        searched, score, MIN_QUALITY, count, np.asarray(taken, np.float64) / factor, min_distance_px / factor,
        border_px // factor, RADIUS_PX // factor, crowd,
    )  # fmt: skip


def spread_peaks(
    image: Image, score: NDArray[np.float32], quality: float, count: int, taken: Array, min_distance_px: float,
    border_px: int, radius_px: int, crowd: float = 1.0,
) -> NDArray[np.float32]:  # fmt: skip
    """Returns the peaks (M, 2) [px] of a score of an image's pixels, of the same size, spread as by `detect_spread`.

    Peaks below `quality` times a strong score, and those without texture within `radius_px`, are discarded.
    """
    height, width = image.shape
    peak = score >= cv2.dilate(score, np.ones((3, 3), np.uint8))
    peak[:border_px], peak[-border_px:], peak[:, :border_px], peak[:, -border_px:] = False, False, False, False
    some = score[::4, ::4].ravel()
    strong = float(np.partition(some, -STRONG_CORNERS)[-STRONG_CORNERS] if score.size > 1000 else score.max())
    row, column = np.nonzero(peak & (score > max(quality * strong, 1e-7)))
    if not len(row):
        return np.zeros((0, 2), np.float32)
    side = np.sqrt(width * height / max(count / 5, 1))
    across, down = max(1, round(width / side)), max(1, round(height / side))
    order = np.argsort(-score[row, column], kind="stable")
    noise = 0.5 * (grey_noise(image) * (2 * radius_px + 1)) ** 2
    return _select(
        read_only(image), radius_px, noise, column[order], row[order], taken, width, height, across, down,
        int(np.ceil(crowd * count / (across * down))), count - len(taken), min_distance_px,
    )  # fmt: skip


@kernel()
def _select(image, radius, noise, column, row, taken, width, height, across, down, per_bucket, count, min_distance):
    """Selects greedily, strongest first; a coarse grid of taken positions limits the distance test to neighbours."""
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
    for i in range(min(len(row), STRONG_CORNERS)):
        strong = max(strong, texture(image, column[i], row[i], radius))
    least = min(MIN_TEXTURE_TO_NOISE * noise, noise + MIN_FAINT_QUALITY * strong)
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


def grey_noise(image: Image) -> float:
    """Returns the standard deviation of an image's pixel noise [grey levels], from its flattest parts; 0 for a small
    image.

    Uses second differences along x and y, which vanish for even shading and straight edges (Immerkaer 1996).
    """
    across, down = image.shape[1] // NOISE_BLOCK_PX, image.shape[0] // NOISE_BLOCK_PX
    if not across or not down:
        return 0.0
    left = np.abs(cv2.sepFilter2D(image, cv2.CV_32F, SECOND_DIFFERENCE, SECOND_DIFFERENCE))
    means = cv2.resize(left, (across, down), interpolation=cv2.INTER_AREA)
    return float(np.sqrt(np.pi / 2) * np.quantile(means, FLAT_SHARE) / (SECOND_DIFFERENCE @ SECOND_DIFFERENCE))


@part
def texture(image, column, row, radius):
    """Returns the change of grey values around a pixel, in the direction of least change.

    It is the smaller eigenvalue of the covariance of the gradients in a square [(grey levels per pixel)^2] (Shi &
    Tomasi 1994); the mean gradient is subtracted, as it does not determine the position if the brightness may differ.
    Noise alone has half its variance per pixel. 0 where the square reaches out of the image.
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


def detect_corners(
    grey: Image,
    count: int,
    taken: NDArray[np.float32] | None = None,
    min_distance_px: float = 8.0,
    border_px: int = 8,
) -> NDArray[np.float32]:
    """Returns up to `count` new corners (M, 2) [px], strongest first, away from `taken` ones (N, 2) and the border."""
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
    """Writes zeros into the mask, whose border is 0, on disks around positions (N, 2)."""
    down, right = np.nonzero(cv2.circle(np.zeros((2 * radius + 1,) * 2, np.uint8), (radius, radius), radius, 1, -1))
    row = np.clip(places[:, 1:] + (down - radius), 0, mask.shape[0] - 1)
    column = np.clip(places[:, :1] + (right - radius), 0, mask.shape[1] - 1)
    mask[row, column] = 0


def at_subpixel(grey: Image, uv: NDArray[np.float32], radius_px: int, iterations: int) -> NDArray[np.float32]:
    """Returns the intersections (M, 2) of the edges around positions (M, 2) (Foerstner & Guelch 1987). A point beside
    its corner would move on the scene when the camera rotates about its axis."""
    start = np.array(uv, np.float32).reshape(-1, 1, 2)
    if not len(start):
        return start.reshape(-1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT, iterations, 0.01)
    exact = cv2.cornerSubPix(grey, start, (radius_px, radius_px), (-1, -1), criteria)
    return np.asarray(exact, np.float32).reshape(-1, 2)
