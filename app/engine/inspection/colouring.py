"""Colours of tracks by one of their values, and the legend of these colours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array

from ...presentation import colours

Colouring = Literal["state", "age", "residual", "depth"]
BINS = 8
UNKNOWN: colours.Rgb = (150, 150, 150)


@dataclass(frozen=True)
class Scale:
    """Bins of equal ratio. Values beyond the ends are in the outermost bins."""

    title: str
    low: float
    high: float

    def bins(self, values: Array) -> NDArray[np.int64]:
        """(N,) 0 to BINS - 1; BINS where the value is unknown (NaN)."""
        known = np.isfinite(values)
        inner = self.edges()[1:-1]
        return np.where(known, np.searchsorted(inner, np.where(known, values, self.low), side="right"), BINS)

    def edges(self) -> Array:
        """(BINS + 1,)."""
        return np.geomspace(self.low, self.high, BINS + 1)

    def labels(self) -> list[str]:
        """Returns the range of each bin as a text; the last one is for unknown values."""
        edges = [f"{edge:.3g}" for edge in self.edges()]
        inner = [f"{a} to {b}" for a, b in pairwise(edges[1:-1])]
        return [f"below {edges[1]}", *inner, f"from {edges[-2]} on", "unknown"]


SCALES: Mapping[Colouring, Scale] = {
    "age": Scale("age [frames of the camera]", 1.0, 256.0),
    "residual": Scale("residual of the last pose [px]", 1 / 16, 4.0),
    "depth": Scale("depth, relative to the image's median", 0.25, 4.0),
}
COLOURINGS: tuple[Colouring, ...] = ("state", *SCALES)


def palette() -> list[colours.Rgb]:
    """Returns the colours of the bins from dark to bright (viridis, which colour-blind people can order, too), and the
    colour of unknown values."""
    levels = np.linspace(40, 255, BINS).astype(np.uint8)[:, None]
    bgr = np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS))[:, 0]
    return [*((int(r), int(g), int(b)) for b, g, r in bgr), UNKNOWN]


def relative_depths(depths: Array) -> Array:
    """Returns depths (N,) divided by their median; NaN where unknown."""
    known = np.isfinite(depths) & (depths > 0)
    return np.where(known, depths / np.median(depths[known]), np.nan) if known.any() else np.full(len(depths), np.nan)
