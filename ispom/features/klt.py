"""Feature tracking by pyramidal Lucas-Kanade with a forward-backward check (Bouguet 2001; Kalal et al. 2010)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.numerics.reductions import both, lengths
from ispom.types import Image, TrackStatus


@dataclass(frozen=True)
class Klt:
    window_px: int = 11
    """Small windows are faster, and less biased where the motion varies."""
    levels: int = 3
    """Pyramid levels above the image itself."""
    iterations: int = 20
    max_forward_backward_px: float = 0.7
    """inf leaves the way back out, where something else checks the place found."""
    border_px: int = 4

    def track(
        self, start: Image, end: Image, uv: NDArray[np.float32], predicted: NDArray[np.float32] | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Places (N, 2) in `end` of points (N, 2) of `start`, and TrackStatus (N,): ALIVE, or why the track ended.

        `predicted` (N, 2): where to begin looking. Of an ended track the place is meaningless.
        """
        if not len(uv):
            return np.zeros((0, 2), np.float32), np.zeros(0, np.uint8)
        forward, found = self._flow(start, end, uv, predicted)
        if np.isfinite(self.max_forward_backward_px):
            status = self.checked(start, end, uv, forward)
        else:
            status = np.full(len(uv), TrackStatus.ALIVE, np.uint8)
            status[self._outside(end, forward)] = TrackStatus.OUT_OF_IMAGE
        status[~found & (status != TrackStatus.OUT_OF_IMAGE)] = TrackStatus.LOST
        return forward, status

    def checked(
        self, start: Image, end: Image, uv: NDArray[np.float32], found_uv: NDArray[np.float32]
    ) -> NDArray[np.uint8]:
        """TrackStatus (N,) of places (N, 2) in `end` that were found by other means: ALIVE where they lead back to the
        points (N, 2) of `start`."""
        back, found = self._flow(end, start, found_uv, uv)
        status = np.full(len(uv), TrackStatus.ALIVE, np.uint8)
        status[lengths(back - uv) > self.max_forward_backward_px] = TrackStatus.FORWARD_BACKWARD
        status[~found] = TrackStatus.LOST
        status[self._outside(end, found_uv)] = TrackStatus.OUT_OF_IMAGE
        return status

    def _outside(self, image: Image, uv: NDArray[np.float32]) -> NDArray[np.bool_]:
        """(N,) which of the places (N, 2) are too near to the image's border, or beyond it."""
        height, width = image.shape
        last = (width - 1 - self.border_px, height - 1 - self.border_px)
        return ~both((uv >= self.border_px) & (uv <= np.array(last, np.float32)))

    def _flow(
        self, a: Image, b: Image, uv: NDArray[np.float32], guess: NDArray[np.float32] | None
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        start = uv if guess is None else guess
        out, found, _ = cv2.calcOpticalFlowPyrLK(
            a,
            b,
            uv.reshape(-1, 1, 2),
            start.astype(np.float32).reshape(-1, 1, 2),
            winSize=(self.window_px, self.window_px),
            maxLevel=self.levels,
            criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, self.iterations, 0.01),
            # The least eigenvalue is there anyway; the error that would be told instead is not, and nobody asks for it.
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW | cv2.OPTFLOW_LK_GET_MIN_EIGENVALS,
            minEigThreshold=1e-4,
        )
        return np.asarray(out, np.float32).reshape(-1, 2), found.ravel() > 0
