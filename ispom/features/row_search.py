"""Matches single points of a rectified pair from left to right: along the row, then to the sub-pixel."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.features.images import factor_of, halved
from ispom.features.klt import Klt
from ispom.features.slanted import align_slanted
from ispom.geometry import Array
from ispom.kernels import kernel, part
from ispom.types import Image, TrackStatus

HALF_ROWS, HALF_COLUMNS = 3, 5
"""Half sizes of the compared patch, at the reduced size."""
NO_COST = 1 << 30
"""A value above all costs."""
MIN_CORRELATION = 0.7
"""Least normalised correlation of a right patch with its left one."""


class RowMatches(NamedTuple):
    """Matches of left points in the right image; NaN where a point was not found."""

    disparity_px: NDArray[np.float32]
    """(N,)."""
    lower_px: NDArray[np.float32]
    """(N,) right row minus left row."""
    slants: Array
    """(N, 2) see slanted.Slanted; 0 where a point was not found."""
    deviations_px: Array
    """(N,) standard deviations of disparities, from the difference of the patches; inf where a point was not found."""
    differences: Array
    """(N,) difference of the patches [grey levels]; inf where a point was not found."""


@dataclass(frozen=True)
class PointSearch:
    """Measures the disparities of given points, with or without a guess."""

    max_disparity_share: float = 0.25
    """Largest disparity of the search, relative to the image width."""
    max_row_error_px: float = 2.0
    """Largest row difference of a match: real rectifications have errors of about a pixel."""
    max_ratio: float = 0.85
    """Largest ratio of the best cost to the best one elsewhere on the row."""
    max_shift_px: float = 3.0
    """Largest correction of a search result, or of a good guess, by the alignment."""
    guided: Klt = field(default_factory=lambda: Klt(levels=1, max_forward_backward_px=np.inf))
    """The tracker from a poor guess; its result is checked by rows, and by callers that know the point in space."""

    def search(
        self, left: Image, right: Image, uv: NDArray[np.float32], halves: tuple[Image, Image] | None = None
    ) -> RowMatches:
        """Searches left points (N, 2) [px]; an ambiguous one is not found.

        `halves`: the halved images, if they were computed before.
        """
        factor = factor_of(left)
        coarse = np.zeros(0, np.float32)
        if len(uv):
            a, b = (_contrast(i) for i in halves or (halved(left), halved(right)))
            place = np.rint(uv / factor).astype(np.int64)
            coarse = _search_rows(a, b, place, int(self.max_disparity_share * a.shape[1]), self.max_ratio)
        found = self._aligned(left, right, uv, uv - _along(factor * coarse))
        unclear = (coarse < 0) | (np.abs(found.disparity_px - factor * coarse) > 2.5 * factor)
        return _without(found, unclear)

    def follow(
        self, left: Image, right: Image, uv: NDArray[np.float32], guess_px: NDArray[np.float32], near: bool = False
    ) -> RowMatches:
        """Searches left points (N, 2) [px] around guesses (N,) of their disparity; `near`: the guesses are good."""
        start = uv - _along(guess_px)
        if near or not len(uv):
            return self._aligned(left, right, uv, start)
        return self._aligned(left, right, uv, self.guided.track(left, right, uv, start)[0])

    def _aligned(self, left: Image, right: Image, uv: NDArray[np.float32], start: NDArray[np.float32]) -> RowMatches:
        found = align_slanted(left, uv, right, start)
        apart, shift = (found.uv - uv).astype(np.float32), found.uv - start
        lost = (found.correlation < MIN_CORRELATION) | (np.abs(apart[:, 1]) > self.max_row_error_px)
        lost |= np.einsum("ni,ni->n", shift, shift) > self.max_shift_px**2
        return _without(RowMatches(-apart[:, 0], apart[:, 1], found.slants, found.deviations, found.differences), lost)


def _along(disparity_px: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns (N, 2)."""
    return np.column_stack([disparity_px, np.zeros_like(disparity_px)])


def _without(found: RowMatches, lost: NDArray[np.bool_]) -> RowMatches:
    for values, nothing in zip(found, (np.nan, np.nan, 0.0, np.inf, np.inf), strict=True):
        values[lost] = nothing
    return found


def _contrast(image: Image) -> NDArray[np.int16]:
    """Returns the differences from the neighbourhood's mean, as the brightness of the two cameras may differ."""
    mean = cv2.blur(image, (2 * HALF_COLUMNS + 1, 2 * HALF_ROWS + 1))
    return np.asarray(cv2.subtract(image, mean, dtype=cv2.CV_16S), np.int16)


@kernel()
def _search_rows(left, right, place, count, max_ratio):
    """Returns the disparity (N,) of least cost, to half a pixel or better by a parabola; -1 where it is ambiguous."""
    height, width = left.shape
    out, cost = np.full(len(place), np.float32(-1)), np.empty(count + 1, np.int32)
    for n in range(len(place)):
        x, y = place[n]
        if not (HALF_COLUMNS <= x < width - HALF_COLUMNS and HALF_ROWS <= y < height - HALF_ROWS):
            continue
        last = min(count, x - HALF_COLUMNS)
        _compare(left, right, x, y, last, cost)
        best, others = last, np.int64(NO_COST)
        for p in range(last, -1, -1):
            if cost[p] < cost[best]:
                best = p
        for p in range(last + 1):
            others = min(others, cost[p] if abs(p - best) > 2 else NO_COST)
        if others < NO_COST and cost[best] > max_ratio * others:
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
    """Fills `cost` with the sums of absolute differences between the patch at x, y and those at disparities `last` to
    0."""
    first = x - last
    cost[: last + 1] = 0
    # The inner loop is over disparities, so that it is vectorised.
    for j in range(-HALF_ROWS, HALF_ROWS + 1):
        for i in range(-HALF_COLUMNS, HALF_COLUMNS + 1):
            own, row = np.int32(left[y + j, x + i]), right[y + j, first + i : x + i + 1]
            for p in range(last + 1):
                cost[p] += abs(own - np.int32(row[p]))


@dataclass(frozen=True)
class RowSearch:
    """Searches the reduced images densely, then tracks to the sub-pixel."""

    coarse_width_px: int = 320
    """The images are reduced to about this width for the dense search."""
    max_disparity_share: float = 0.2
    """Largest disparity of the search, relative to the image width."""
    max_row_error_px: float = 2.0
    """Largest row difference of a match: real rectifications have errors of about a pixel."""
    refine: Klt = field(default_factory=lambda: Klt(levels=1, max_forward_backward_px=0.5))
    """The sub-pixel search."""

    def disparity(
        self, left: Image, right: Image, uv: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Returns disparities (N,) [px], NaN where unknown, and TrackStatus (N,) ALIVE or NO_DISPARITY, of left points
        (N, 2).

        Semi-global matching (Hirschmueller 2008) on reduced images gives the start, Lucas-Kanade the sub-pixel
        position.
        """
        if not len(uv):
            return np.zeros(0, np.float32), np.zeros(0, np.uint8)
        guess = uv.copy()
        guess[:, 0] -= self._coarse(left, right, uv)
        found, status = self.refine.track(left, right, uv, guess)
        disparity = uv[:, 0] - found[:, 0]
        good = (status == TrackStatus.ALIVE) & (np.abs(uv[:, 1] - found[:, 1]) <= self.max_row_error_px)
        good &= (disparity > 0) & (np.abs(found[:, 0] - guess[:, 0]) <= 2.5 * left.shape[1] / self.coarse_width_px)
        return (
            np.where(good, disparity, np.nan).astype(np.float32),
            np.where(good, TrackStatus.ALIVE, TrackStatus.NO_DISPARITY).astype(np.uint8),
        )

    def _coarse(self, left: Image, right: Image, uv: NDArray[np.float32]) -> NDArray[np.float32]:
        factor = min(1.0, self.coarse_width_px / left.shape[1])
        size = (round(left.shape[1] * factor), round(left.shape[0] * factor))
        count = 16 * max(1, round(self.max_disparity_share * size[0] / 16))
        small_left, small_right = (cv2.resize(i, size, interpolation=cv2.INTER_AREA) for i in (left, right))
        # Without padding on the left, the first `count` columns would have no disparity.
        padded = [cv2.copyMakeBorder(i, 0, 0, count, 0, cv2.BORDER_REPLICATE) for i in (small_left, small_right)]
        matcher = cv2.StereoSGBM.create(
            0, count, 5, P1=8 * 25, P2=32 * 25, disp12MaxDiff=-1, uniquenessRatio=0, mode=cv2.STEREO_SGBM_MODE_SGBM
        )
        coarse = matcher.compute(*padded)[:, count:].astype(np.float32) / 16
        column = np.clip(np.rint((uv[:, 0] + 0.5) * factor - 0.5).astype(int), 0, size[0] - 1)
        row = np.clip(np.rint((uv[:, 1] + 0.5) * factor - 0.5).astype(int), 0, size[1] - 1)
        return (np.maximum(coarse[row, column], 0) / factor).astype(np.float32)
