"""Groups tracks that move a pose together: neighbours in the image that pull it the same way, as tracks on a bus do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform

from ispom.geometry import Array

MAX_EXTENT = 0.25
"""Largest distance between two tracks of a group, relative to the extent of all tracks in the image: near cars and
people are about as wide."""
MAX_ANGLE_DEG = 60.0
"""Largest angle between the pulls of two tracks of a group [deg]; the mean of unrelated directions is 90."""
MIN_TRACKS = 3
"""Least number of tracks of a group: two neighbours may agree by chance."""
MIN_PULL = 0.1
"""Least pull of a track in a group, relative to the median of the strongest tenth."""


def groups(at: Array, pulls: Array) -> list[NDArray[np.int64]]:
    """Returns the row numbers of each group of tracks, the group with the largest pull first.

    `at` (M, 2): positions in the image, NaN where unknown. `pulls` (M, 3): shift of the pose by each track.
    Deterministic, and independent of units.
    """
    sizes = np.linalg.norm(pulls, axis=1)
    rows = np.flatnonzero(np.isfinite(at).all(axis=1) & np.isfinite(sizes) & (sizes > 0))
    if len(rows) < MIN_TRACKS:
        return []
    strongest = np.sort(sizes[rows])[-max(1, len(rows) // 10) :]
    rows = rows[sizes[rows] >= MIN_PULL * np.median(strongest)]
    if len(rows) < MIN_TRACKS:
        return []
    extent = float(np.ptp(at[np.isfinite(at).all(axis=1)], axis=0).max())
    apart = np.linalg.norm(at[rows, None] - at[None, rows], axis=2)
    ways = pulls[rows] / sizes[rows, None]
    turned = np.arccos(np.clip(ways @ ways.T, -1, 1)) / np.radians(MAX_ANGLE_DEG)
    far = np.maximum(apart / (MAX_EXTENT * extent), turned)
    np.fill_diagonal(far, 0.0)
    label = fcluster(linkage(squareform(far, checks=False), "complete"), 1.0, "distance")
    found = [rows[label == n] for n in np.unique(label)]
    found = [some for some in found if len(some) >= MIN_TRACKS]
    return sorted(found, key=lambda some: (-float(np.linalg.norm(pulls[some].sum(axis=0))), int(some[0])))
