"""Left to right correspondence in a rectified pair: a coarse search along the row, then sub-pixel tracking."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.features.klt import Klt
from ispom.types import Image, TrackStatus


@dataclass(frozen=True)
class RowSearch:
    coarse_width_px: int = 320
    """The images are reduced to about this width for the dense search."""
    max_disparity_share: float = 0.2
    """Largest disparity looked for, as a share of the image width."""
    max_row_error_px: float = 2.0
    """Real rectifications are off by a pixel or so."""
    refine: Klt = field(default_factory=lambda: Klt(levels=1, max_forward_backward_px=0.5))
    """The sub-pixel search."""

    def disparity(
        self, left: Image, right: Image, uv: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Disparities (N,) [px], NaN where unknown, and TrackStatus (N,) ALIVE or NO_DISPARITY, of left points (N, 2).

        Semi-global matching (Hirschmueller 2008) on reduced images finds the way, Lucas-Kanade the sub-pixel place.
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
        # Without padding on the left, the first `count` columns would have no disparity at all.
        padded = [cv2.copyMakeBorder(i, 0, 0, count, 0, cv2.BORDER_REPLICATE) for i in (small_left, small_right)]
        matcher = cv2.StereoSGBM.create(
            0, count, 5, P1=8 * 25, P2=32 * 25, disp12MaxDiff=-1, uniquenessRatio=0, mode=cv2.STEREO_SGBM_MODE_SGBM
        )
        coarse = matcher.compute(*padded)[:, count:].astype(np.float32) / 16
        column = np.clip(np.rint((uv[:, 0] + 0.5) * factor - 0.5).astype(int), 0, size[0] - 1)
        row = np.clip(np.rint((uv[:, 1] + 0.5) * factor - 0.5).astype(int), 0, size[1] - 1)
        return (np.maximum(coarse[row, column], 0) / factor).astype(np.float32)
