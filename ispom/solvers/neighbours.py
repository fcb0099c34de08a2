"""Groups of neighbours in the image, whose errors hang together.

Neighbours share pixels, a surface and what stands before it: at the truth of sim:tiny and indoors, what they say of a
pose hangs together up to some 90 px apart, which adds a fifth to its variance. Covariances are therefore made of the
squares of what groups say (Liang & Zeger 1986), each as it would be, to first order, had the group had no part in the
estimate (a jackknife: Bell & McCaffrey 2002), and as much larger as few groups leave open (Student's t).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.kernels import kernel

CELLS = 7, 5
"""Of the image, across and down: what is seen in one is a group. In images of 640 pixels a cell is as wide as
neighbours hang together."""
SHIFTS = (0.0, 0.0), (0.5, 0.5)
"""Of the cells, in cells; squares are the mean over them: neighbours on both sides of a border are a group in
another."""
GROUPS = (CELLS[0] + 1) * (CELLS[1] + 1)
"""That there are at most."""
POSE = 6
"""Unknowns of a pose."""
LEAST_SHARE = 0.1
"""Of groups that count, where there are hardly more than unknowns."""


def cells(seen: Array) -> list[NDArray[np.int64]]:
    """For each of SHIFTS the groups (M,), numbers below GROUPS, of what is seen at (M, 2)."""
    low, high = seen.min(axis=0), seen.max(axis=0)
    place = (seen - low) / np.maximum(high - low, 1e-12) * (1 - 1e-9) * CELLS
    return [(place + shift).astype(np.int64) @ (CELLS[1] + 1, 1) for shift in SHIFTS]


def by_group(count: int, groups: NDArray[np.int64], rows: Array) -> Array:
    """(G, D) sums of `rows` (M, D) over what is in each of `count` groups; `groups` (M,)."""
    out = np.zeros((count, rows.shape[1]))
    _sum(groups, rows, out)
    return out


def left_open(groups: float) -> float:
    """By how much the squares of deviations of a pose are larger than so many groups show: the mean of an inverse
    Wishart matrix."""
    return groups / max(groups - POSE - 1, LEAST_SHARE * groups) if groups else 1.0


@kernel()
def _sum(groups, rows, out):
    for m in range(len(rows)):
        row, into = rows[m], out[groups[m]]
        for d in range(len(into)):
            into[d] += row[d]
