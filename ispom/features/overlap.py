"""Matches points between two cameras of a rig with overlapping fields of view, at any relative orientation.

The image of the second camera is first rotated to the orientation of the first one (a constant map of pixels). Then
each point is searched along its epipolar line, over inverse depths, by normalised correlation, and aligned to the
sub-pixel by Lucas-Kanade.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.cameras import Camera
from ispom.features.klt import Klt
from ispom.geometry import Array, Pose
from ispom.types import Image, TrackStatus

PATCH_RADIUS_PX = 4
"""Radius of the square patches, whose side is 9 px."""
STEP_PX, MAX_STEPS = 1.5, 128
"""Step between positions on the epipolar line, and their largest number."""
MIN_CORRELATION, MAX_RATIO, NEIGHBOURS = 0.8, 0.95, 3
"""Least correlation of a match; largest ratio of the second best correlation to the best one; number of neighbours, on
each side of the best position, that are not the second best."""
MIN_TEXTURE = 4.0
"""Least standard deviation of a patch [grey levels]."""
MAX_EPIPOLAR_PX = 1.0
"""Largest distance of a match from its epipolar line, which errors of calibrations explain."""
MIN_OVERLAP = 0.02
"""Least share of the first image that the second camera must observe."""
ALIGN = Klt(window_px=11, levels=1, max_forward_backward_px=0.5)


@dataclass(frozen=True, eq=False)
class Overlap:
    """The overlap of one camera's image with the field of view of another one."""

    first: Camera
    first_from_second: Pose
    maps: tuple[Array, Array]
    """(H, W) columns and rows in the second image, for the rays of the first one's pixels."""
    visible: NDArray[np.bool_]
    """(H, W) whether the second camera observes them."""

    @staticmethod
    def of(first: Camera, second: Camera, first_from_second: Pose) -> Overlap | None:
        """Returns the overlap of two cameras; None where it is less than `MIN_OVERLAP` of the image."""
        u, v = np.meshgrid(np.arange(first.width), np.arange(first.height))
        rays, valid = first.unproject(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
        turned = rays @ first_from_second.rotation
        valid &= turned[:, 2] > 0.05  # wide lenses are modelled up to some angle only
        uv = np.full((len(turned), 2), -1e4)
        uv[valid] = second.project(turned[valid])
        last = np.array([second.width, second.height]) - 1 - PATCH_RADIUS_PX
        inside = np.asarray(((uv > PATCH_RADIUS_PX) & (uv < last)).all(axis=1))
        if np.mean(inside) < MIN_OVERLAP:
            return None
        columns, rows = (np.where(np.isfinite(c), c, -1e4).reshape(u.shape).astype(np.float32) for c in uv.T)
        return Overlap(first, first_from_second, (columns, rows), inside.reshape(u.shape))

    def match(
        self, image: Image, second_image: Image, uv: NDArray[np.float32], nearest_m: float
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Matches points (N, 2) [px] of the first camera, whose depth is at least `nearest_m`.

        Returns observations (N, 2) on the plane z = 1 of the second camera, and the mask (N,) of the matched ones.
        """
        xy, found = np.full((len(uv), 2), np.nan), np.zeros(len(uv), bool)
        seen_turned = np.asarray(cv2.remap(second_image, *self.maps, cv2.INTER_LINEAR), np.uint8)
        lines, length_px = self._lines(uv, nearest_m)
        some = np.flatnonzero(np.isfinite(length_px))
        start, some = self._search(image, seen_turned, uv, lines, length_px, some)
        if not len(some):
            return xy, found
        aligned, status = ALIGN.track(image, seen_turned, uv[some], start)
        first, last = lines[some, 0], lines[some, -1]
        way = (last - first) / np.maximum(np.linalg.norm(last - first, axis=1, keepdims=True), 1e-9)
        off = (aligned - first)[:, 0] * way[:, 1] - (aligned - first)[:, 1] * way[:, 0]
        near = (np.abs(off) <= MAX_EPIPOLAR_PX) & (np.abs(aligned - start).max(axis=1) <= 2 * STEP_PX)
        good = (status == TrackStatus.ALIVE) & near & self._sees(aligned)
        rays, valid = self.first.unproject(aligned)
        turned = rays @ self.first_from_second.rotation
        good &= valid & (turned[:, 2] > 0.05)
        found[some[good]] = True
        xy[some[good]] = turned[good, :2] / turned[good, 2:]
        return xy, found

    def _lines(self, uv: NDArray[np.float32], nearest_m: float) -> tuple[Array, Array]:
        """Returns positions (N, D, 2) for inverse depths from 0 on, and the lengths (N,) of the lines [px]; NaN where
        the point would be behind the second camera, or outside of its field of view."""
        rays = np.column_stack([self.first.normalise(uv), np.ones(len(uv))])
        nearest = rays - self.first_from_second.translation / nearest_m
        longest = np.linalg.norm(self.first.project(nearest) - uv, axis=1)
        most = float(np.nanmax(longest, initial=0.0)) if np.isfinite(longest).any() else 0.0
        steps = int(np.clip(np.ceil(most / STEP_PX), 2, MAX_STEPS))
        rho = np.linspace(0, 1 / nearest_m, steps + 1)
        at = rays[:, None] - rho[:, None] * self.first_from_second.translation
        return self.first.project(at.reshape(-1, 3)).reshape(len(uv), steps + 1, 2), longest

    def _search(
        self, image: Image, other: Image, uv: NDArray[np.float32], lines: Array, length_px: Array, some: NDArray
    ) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """Returns the most similar positions (K, 2), and the indices (K,) of the points with an unambiguous one."""
        visible = self._sees(lines[some].reshape(-1, 2)).reshape(len(some), lines.shape[1])
        some, visible = some[visible.any(axis=1)], visible[visible.any(axis=1)]
        if not len(some):
            return np.zeros((0, 2), np.float32), some
        own = _patches(image, uv[some, None])
        scores = np.einsum("nip,ndp->nd", own, _patches(other, lines[some]))
        scores[~visible] = -1.0
        best = scores.argmax(axis=1)
        top = scores[np.arange(len(some)), best]
        rivals = np.abs(np.arange(lines.shape[1]) - best[:, None]) > NEIGHBOURS
        second = np.where(rivals, scores, -1.0).max(axis=1)
        clear = (top >= MIN_CORRELATION) & (second <= MAX_RATIO * top) & np.isfinite(length_px[some])
        # If the next position is outside of the image, the best one may be outside, too.
        last, rows = lines.shape[1] - 1, np.arange(len(some))
        clear &= visible[rows, np.minimum(best + 1, last)] & visible[rows, np.maximum(best - 1, 0)]
        return lines[some[clear], best[clear]].astype(np.float32), some[clear]

    def _sees(self, uv: Array) -> NDArray[np.bool_]:
        """Returns the mask (N,) of the positions (N, 2) in the first image that the second camera observes."""
        height, width = self.visible.shape
        column, row = np.clip(np.nan_to_num(np.asarray(uv, float), nan=-1.0), -1, 1e6).T
        inside = (column >= 0) & (column <= width - 1) & (row >= 0) & (row <= height - 1)
        at = np.clip(np.rint(row), 0, height - 1).astype(int), np.clip(np.rint(column), 0, width - 1).astype(int)
        return inside & self.visible[at]


def _patches(image: Image, uv: Array) -> Array:
    """Returns patches (N, D, P) around positions (N, D, 2) with mean 0 and length 1; 0 where there is no texture."""
    side = np.arange(-PATCH_RADIUS_PX, PATCH_RADIUS_PX + 1)
    du, dv = (offset.ravel() for offset in np.meshgrid(side, side))
    at = np.nan_to_num(uv, nan=-100.0).reshape(-1, 1, 2)
    columns, rows = (at[..., 0] + du).astype(np.float32), (at[..., 1] + dv).astype(np.float32)
    pieces = [  # remap takes images of less than 2^15 rows
        cv2.remap(image, columns[n : n + 30000], rows[n : n + 30000], cv2.INTER_LINEAR)
        for n in range(0, len(columns), 30000)
    ]
    patches = np.concatenate(pieces).astype(np.float32)
    patches -= patches.mean(axis=1, keepdims=True)
    length = np.sqrt((patches**2).sum(axis=1, keepdims=True))
    enough = length > MIN_TEXTURE * len(du) ** 0.5
    return np.where(enough, patches / np.maximum(length, 1e-9), 0.0).reshape(*uv.shape[:2], -1)
