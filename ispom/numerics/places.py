"""Finds ids in sorted arrays of ids."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def places(known: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.int64]:
    """Returns the index (N,) of each wanted id (N,) among the known ones (M,), which ascend; -1 if absent."""
    if not len(known):
        return np.full(len(wanted), -1, np.int64)
    at = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
    return np.where(known[at] == wanted, at, -1)


def common(a: NDArray[np.int64], b: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns the indices (K,) in a (N,), and in b (M,), of the ids that both contain; both ascend."""
    at = places(b, a)
    has = np.flatnonzero(at >= 0)
    return has, at[has]
