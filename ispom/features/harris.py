"""Harris corners (Harris and Stephens 1988): peaks of det M - k (trace M)^2, M the autocorrelation of the gradients."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.features.images import factor_of, halved
from ispom.features.patches import RADIUS_PX
from ispom.features.shi_tomasi import MIN_QUALITY, spread_peaks
from ispom.types import Image

TRACE_WEIGHT = 0.04
"""Weight k of the squared trace, 0.04 to 0.06 in Harris and Stephens 1988: an edge, whose trace is large and
determinant small, gets a negative score."""
BORDER_PX = 8
"""Least distance of a corner from the image's border."""


@dataclass(frozen=True)
class Harris:
    """A Detector of the strongest corners of an even spread over the image."""

    def detect(
        self, grey: Image, count: int, occupied: NDArray[np.float32], min_distance_px: float
    ) -> NDArray[np.float32]:
        """See interfaces.Detector. Large images are searched at half size, as for Shi-Tomasi corners."""
        if not grey.size:
            return np.zeros((0, 2), np.float32)
        factor, searched = factor_of(grey), halved(grey)
        score = np.asarray(cv2.cornerHarris(searched, 3, 3, TRACE_WEIGHT), np.float32)
        # The score is of the order of the eigenvalues' product: their relative limit is squared.
        return factor * spread_peaks(
            searched, score, MIN_QUALITY**2, count, np.asarray(occupied, np.float64) / factor, min_distance_px / factor,
            BORDER_PX // factor, RADIUS_PX // factor,
        )  # fmt: skip
