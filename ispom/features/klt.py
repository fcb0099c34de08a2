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
    """A Tracker by pyramidal Lucas-Kanade."""

    window_px: int = 11
    """Side of the window; small windows are faster, and less biased if the motion varies within them."""
    levels: int = 3
    """Number of pyramid levels above the image itself."""
    iterations: int = 20
    max_forward_backward_px: float = 0.7
    """Largest error of the forward-backward check; inf skips it, if the caller checks the result."""
    border_px: int = 4
    back_from_guess: bool = False
    """The search back starts as far from its answer as the search forward did, not at the answer: a check that
    knows less passes fewer wrong tracks in blurred images, where a search ends near its start."""

    def track(
        self, start: Image, end: Image, uv: NDArray[np.float32], predicted: NDArray[np.float32] | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Returns positions (N, 2) [px] in `end` of points (N, 2) of `start`, and TrackStatus (N,): ALIVE, or why it
        ended.

        The search starts at `predicted` (N, 2). The position of an ended track is meaningless.
        """
        if not len(uv):
            return np.zeros((0, 2), np.float32), np.zeros(0, np.uint8)
        forward, found = self._flow(start, end, uv, predicted)
        if np.isfinite(self.max_forward_backward_px):
            status = self.checked(start, end, uv, forward, predicted)
        else:
            status = np.full(len(uv), TrackStatus.ALIVE, np.uint8)
            status[self._outside(end, forward)] = TrackStatus.OUT_OF_IMAGE
        status[~found & (status != TrackStatus.OUT_OF_IMAGE)] = TrackStatus.LOST
        return forward, status

    def checked(
        self,
        start: Image,
        end: Image,
        uv: NDArray[np.float32],
        found_uv: NDArray[np.float32],
        predicted: NDArray[np.float32] | None = None,
    ) -> NDArray[np.uint8]:
        """Returns the TrackStatus (N,) of positions (N, 2) in `end` found by other means: ALIVE if tracking back leads
        to the points (N, 2) of `start`.

        `predicted` (N, 2) is where the search forward started; only `back_from_guess` needs it.
        """
        back, found = self._flow(end, start, found_uv, self._back_guess(uv, found_uv, predicted))
        status = np.full(len(uv), TrackStatus.ALIVE, np.uint8)
        status[lengths(back - uv) > self.max_forward_backward_px] = TrackStatus.FORWARD_BACKWARD
        status[~found] = TrackStatus.LOST
        status[self._outside(end, found_uv)] = TrackStatus.OUT_OF_IMAGE
        return status

    def _back_guess(
        self, uv: NDArray[np.float32], found_uv: NDArray[np.float32], predicted: NDArray[np.float32] | None
    ) -> NDArray[np.float32]:
        if not self.back_from_guess:
            return uv
        return found_uv if predicted is None else (found_uv + (uv - predicted)).astype(np.float32)

    def _outside(self, image: Image, uv: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Returns a mask (N,) of the positions (N, 2) that are near the image's border or outside."""
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
            # OpenCV computes the least eigenvalue anyway; its alternative, an error measure, costs time and is unused.
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW | cv2.OPTFLOW_LK_GET_MIN_EIGENVALS,
            minEigThreshold=1e-4,
        )
        return np.asarray(out, np.float32).reshape(-1, 2), found.ravel() > 0
