"""Points weighed by the area that they stand for, not by how many there are."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

CELLS = 8
"""Along each side of what the points cover."""


def area_weights(places: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """(N,) for places (N, 2): each cell of a grid over them has weight 1, which its points share."""
    low, high = places.min(axis=0), places.max(axis=0)
    cell = np.minimum((CELLS * (places - low) / np.maximum(high - low, 1e-12)).astype(np.int64), CELLS - 1)
    number = cell[:, 0] * CELLS + cell[:, 1]
    return 1.0 / np.bincount(number)[number]


def weighted_median(values: NDArray[np.floating[Any]], weights: NDArray[np.floating[Any]]) -> float:
    """The least of the values (N,) that, with those below it, have half of the weight (N,)."""
    order = np.argsort(values, kind="stable")
    sums = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(sums, 0.5 * sums[-1])]])
