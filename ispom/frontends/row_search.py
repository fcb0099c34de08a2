"""Left to right correspondence of single points: sums of absolute differences along the row, then Lucas-Kanade."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.frontends.halved import factor_of, halved
from ispom.frontends.klt import Klt
from ispom.kernels import kernel, part
from ispom.types import Image, TrackStatus

HALF_ROWS, HALF_COLUMNS = 3, 5
"""Half sizes of the compared patch, at the reduced size."""
NONE = 1 << 30
"""No cost is so high."""


@dataclass(frozen=True)
class PointSearch:
    """Disparities of points, with or without a guess: only the points asked for are looked at."""

    max_disparity_share: float = 0.25
    """Largest disparity looked for, as a share of the image width."""
    max_row_error_px: float = 2.0
    """Real rectifications are off by a pixel or so."""
    max_ratio: float = 0.85
    """Best cost against the best cost elsewhere on the row."""
    refine: Klt = field(default_factory=lambda: Klt(levels=0, max_forward_backward_px=0.5))
    """The sub-pixel place of what was searched for, and found to a pixel."""
    guided: Klt = field(default_factory=lambda: Klt(levels=1, max_forward_backward_px=np.inf))
    """The place near a guess; rows, and whoever knows the point in space, check it."""
    near: Klt = field(default_factory=lambda: Klt(levels=0, max_forward_backward_px=np.inf))
    """The same of a good guess, off by some pixels at most."""

    def search(
        self, left: Image, right: Image, uv: NDArray[np.float32], halves: tuple[Image, Image] | None = None
    ) -> NDArray[np.float32]:
        """Disparities (N,) [px] of left points (N, 2), NaN where none is clear.

        `halves`: the halved images, where they are there already.
        """
        if not len(uv):
            return np.zeros(0, np.float32)
        factor = factor_of(left)
        a, b = (_contrast(i) for i in halves or (halved(left), halved(right)))
        place = np.rint(uv / factor).astype(np.int64)
        coarse = _search_rows(a, b, place, int(self.max_disparity_share * a.shape[1]), self.max_ratio)
        found = coarse >= 0
        out = np.full(len(uv), np.nan, np.float32)
        out[found] = self._sub_pixel(self.refine, left, right, uv[found], factor * coarse[found])[0]
        far = np.abs(out - factor * coarse) > 2.5 * factor
        out[far] = np.nan
        return out

    def follow(
        self, left: Image, right: Image, uv: NDArray[np.float32], guess_px: NDArray[np.float32], near: bool = False
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Disparities (N,) [px] of left points (N, 2) about guesses (N,), which are good ones where they are `near`;
        and how much lower they are on the right (N,).

        NaN where lost or off the row.
        """
        return self._sub_pixel(self.near if near else self.guided, left, right, uv, guess_px)

    def _sub_pixel(
        self, klt: Klt, left: Image, right: Image, uv: NDArray[np.float32], guess_px: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        start = uv.copy()
        start[:, 0] -= guess_px
        found, status = klt.track(left, right, uv, start)
        apart = found - uv
        good = (status == TrackStatus.ALIVE) & (np.abs(apart[:, 1]) <= self.max_row_error_px)
        apart[~good] = np.nan
        return -apart[:, 0], apart[:, 1]


def _contrast(image: Image) -> NDArray[np.int16]:
    """Differences to the neighbourhood's mean: the two cameras may differ in brightness."""
    mean = cv2.blur(image, (2 * HALF_COLUMNS + 1, 2 * HALF_ROWS + 1))
    return np.asarray(cv2.subtract(image, mean, dtype=cv2.CV_16S), np.int16)


@kernel()
def _search_rows(left, right, place, count, max_ratio):
    """Disparity (N,) of the lowest cost, to half a pixel or better by a parabola; -1 where it is not clear."""
    height, width = left.shape
    out, cost = np.full(len(place), np.float32(-1)), np.empty(count + 1, np.int32)
    for n in range(len(place)):
        x, y = place[n]
        if not (HALF_COLUMNS <= x < width - HALF_COLUMNS and HALF_ROWS <= y < height - HALF_ROWS):
            continue
        last = min(count, x - HALF_COLUMNS)
        _compare(left, right, x, y, last, cost)
        best, others = last, np.int64(NONE)
        for p in range(last, -1, -1):
            if cost[p] < cost[best]:
                best = p
        for p in range(last + 1):
            others = min(others, cost[p] if abs(p - best) > 2 else NONE)
        if others < NONE and cost[best] > max_ratio * others:
            continue
        offset = 0.0
        if 0 < best < last:
            bend = cost[best - 1] - 2 * cost[best] + cost[best + 1]
            if bend > 0:
                offset = 0.5 * (cost[best + 1] - cost[best - 1]) / bend
        out[n] = last - best + offset
    return out


@part
def _compare(left, right, x, y, last, cost):
    """Sums of absolute differences of the patch at x, y and those at disparities `last` to 0, into `cost`."""
    first = x - last
    cost[: last + 1] = 0
    # All disparities for one pixel of the patch after another: so many go at a time.
    for j in range(-HALF_ROWS, HALF_ROWS + 1):
        for i in range(-HALF_COLUMNS, HALF_COLUMNS + 1):
            own, row = np.int32(left[y + j, x + i]), right[y + j, first + i : x + i + 1]
            for p in range(last + 1):
                cost[p] += abs(own - np.int32(row[p]))
