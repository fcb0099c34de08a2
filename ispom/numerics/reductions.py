"""Reductions that are needed many times at each exposure: the numbers are numpy's own, which takes three times as long
for rows of two, and ten times as long for a median."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def lengths(rows: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """(N,) of vectors (N, 2)."""
    return np.sqrt(squares(rows))


def squares(rows: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """(N,) squared lengths of vectors (N, 2)."""
    x, y = rows[:, 0], rows[:, 1]
    return x * x + y * y


def both(rows: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) of (N, 2)."""
    return rows[:, 0] & rows[:, 1]


def median(values: NDArray[np.floating[Any]]) -> float:
    """Of (N,), N > 0, without NaN: of an even number the mean of both in the middle."""
    middle = len(values) // 2
    if len(values) % 2:
        return float(np.partition(values, middle)[middle])
    low, high = np.partition(values, (middle - 1, middle))[middle - 1 : middle + 1].tolist()
    return (low + high) / 2
