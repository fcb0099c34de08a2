"""Tracks that move a pose together: neighbours in the image that pull it the same way, as those of a bus do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform

from ispom.geometry import Array

WIDE = 0.25
"""Most distance between two tracks of a group, relative to the extent of the tracks in the image: near cars and people
are about this wide."""
TURNED_DEG = 60.0
"""Most angle between the ways that two of them pull [deg]; the mean of two that have nothing in common is 90."""
LEAST_TRACKS = 3
"""Fewer are no group: two neighbours agree by chance."""
COUNTING = 0.1
"""Least pull of a track in a group, relative to the median of the strongest tenth."""


def groups(at: Array, pulls: Array) -> list[NDArray[np.int64]]:
    """Returns the rows of each group of tracks at (M, 2), NaN where unknown, that pull a pose by (M, 3), largest first.

    Deterministic, and independent of units.
    """
    sizes = np.linalg.norm(pulls, axis=1)
    rows = np.flatnonzero(np.isfinite(at).all(axis=1) & np.isfinite(sizes) & (sizes > 0))
    if len(rows) < LEAST_TRACKS:
        return []
    strongest = np.sort(sizes[rows])[-max(1, len(rows) // 10) :]
    rows = rows[sizes[rows] >= COUNTING * np.median(strongest)]
    if len(rows) < LEAST_TRACKS:
        return []
    extent = float(np.ptp(at[np.isfinite(at).all(axis=1)], axis=0).max())
    apart = np.linalg.norm(at[rows, None] - at[None, rows], axis=2)
    ways = pulls[rows] / sizes[rows, None]
    turned = np.arccos(np.clip(ways @ ways.T, -1, 1)) / np.radians(TURNED_DEG)
    far = np.maximum(apart / (WIDE * extent), turned)
    np.fill_diagonal(far, 0.0)
    label = fcluster(linkage(squareform(far, checks=False), "complete"), 1.0, "distance")
    found = [rows[label == n] for n in np.unique(label)]
    found = [some for some in found if len(some) >= LEAST_TRACKS]
    return sorted(found, key=lambda some: (-float(np.linalg.norm(pulls[some].sum(axis=0))), int(some[0])))
