"""Weights of points by the area that they represent, not by their number."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

CELLS = 8
"""Number of cells along each side of the points' bounding box."""


def area_weights(places: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """Returns weights (N,) of positions (N, 2): each cell of a grid over them has weight 1, shared by its points."""
    low, high = places.min(axis=0), places.max(axis=0)
    cell = np.minimum((CELLS * (places - low) / np.maximum(high - low, 1e-12)).astype(np.int64), CELLS - 1)
    number = cell[:, 0] * CELLS + cell[:, 1]
    return 1.0 / np.bincount(number)[number]


def weighted_median(values: NDArray[np.floating[Any]], weights: NDArray[np.floating[Any]]) -> float:
    """Returns the weighted median: the least of the values (N,) up to which half of the weight (N,) lies."""
    order = np.argsort(values, kind="stable")
    sums = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(sums, 0.5 * sums[-1])]])
