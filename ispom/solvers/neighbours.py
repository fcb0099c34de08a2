"""What the tracks of one window, or of one image, say of a pose together, as neighbours in it share errors.

Neighbours share pixels, a surface and what stands before it: at the truth of sim:tiny and indoors, what they say of a
pose hangs together up to some 90 px apart, which adds a tenth to its variance. So a covariance is the sum of the
squares of what each track says (Liang & Zeger 1986), as it would be, to first order, had it had no part in the estimate
(a jackknife: Bell & McCaffrey 2002), and as much larger as the squares of what groups of neighbours say are. Groups
alone would do, but fifteen of them say most of a pose, and a covariance of six axes that so few show is off: errors
tested by it look half as large again as they are. What the tracks leave open of that is added (Student's t).
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
LEAST_SHARE = 0.1
"""Of tracks that count, where hardly more say something than there are unknowns."""


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


def cluster_inflation(alone: Array, groups: list[Array]) -> float:
    """By how much the squares of deviations of a pose are larger than those of what each track says of it, `alone`
    (N, D), for what they share and leave open. Each of `groups` (G, D) is what groups of them say: one or more ways to
    tell neighbours apart."""
    inverse = _inverse(alone)
    together = sum(float(np.sum(inverse * (each.T @ each))) for each in groups) / (len(groups) * alone.shape[1])
    return max(together, 1.0) * small_sample_factor(alone, max(together, 1.0))


def small_sample_factor(alone: Array, together: float = 1.0) -> float:
    """By how much the squares of deviations are larger than those of what each track says, `alone` (N, D), show: the
    mean of an inverse Wishart matrix of as many that say equally much, by their fourth moments.

    Where they say the same `together` times over, they are so many fewer.
    """
    axes, sizes = alone.shape[1], np.einsum("ni,ij,nj->n", alone, _inverse(alone), alone)
    if not sizes.any():
        return 1.0
    count = axes * (axes + 2) / float(sizes @ sizes) / together
    return count / max(count - axes - 1, LEAST_SHARE * count)


def _inverse(alone: Array) -> Array:
    """(D, D) of the squares; 0 in a direction of which nothing is said."""
    return np.linalg.pinv(alone.T @ alone, rtol=1e-12, hermitian=True)


@kernel()
def _sum(groups, rows, out):
    for m in range(len(rows)):
        row, into = rows[m], out[groups[m]]
        for d in range(len(into)):
            into[d] += row[d]
