"""Interpolates values by a cubic with continuous second derivative, and third next to both ends (not-a-knot).

The curve is that of scipy.interpolate, whose import would take 14 MB and 0.2 s in the middle of a run.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_banded

from ispom.geometry import Array


def cubic_at(knots: Array, values: Array, at: Array) -> Array:
    """Returns the curve (M, D) at `at` (M,), through `values` (N, D) at at least two increasing `knots` (N,).

    Three values give a parabola, two a line. De Boor 1978, A Practical Guide to Splines, chapter IV.
    """
    h = np.diff(knots)
    rise = np.diff(values, axis=0) / h[:, None]
    slope = _slopes(h, rise)
    i = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(h) - 1)
    u, step = (at - knots[i])[:, None], h[i, None]
    square = (3 * rise[i] - 2 * slope[i] - slope[i + 1]) / step
    cube = (slope[i] + slope[i + 1] - 2 * rise[i]) / step**2
    return values[i] + u * (slope[i] + u * (square + u * cube))


def _slopes(h: Array, rise: Array) -> Array:
    """Returns the slopes (N, D) at the knots, from intervals (N - 1,) and difference quotients (N - 1, D)."""
    if len(h) == 1:
        return rise[[0, 0]]
    if len(h) == 2:
        bend = (rise[1] - rise[0]) / h.sum()
        return np.stack([rise[0] - h[0] * bend, rise[0] + h[0] * bend, rise[1] + h[1] * bend])
    banded, right = np.zeros((3, len(h) + 1)), np.zeros((len(h) + 1, rise.shape[1]))
    banded[0, 2:], banded[1, 1:-1], banded[2, :-2] = h[:-1], 2 * (h[:-1] + h[1:]), h[1:]
    right[1:-1] = 3 * (h[1:, None] * rise[:-1] + h[:-1, None] * rise[1:])
    first, last = h[0] + h[1], h[-1] + h[-2]
    banded[1, 0], banded[0, 1], banded[2, -2], banded[1, -1] = h[1], first, last, h[-2]
    right[0] = ((h[0] + 2 * first) * h[1] * rise[0] + h[0] ** 2 * rise[1]) / first
    right[-1] = (h[-1] ** 2 * rise[-2] + (2 * last + h[-1]) * h[-2] * rise[-1]) / last
    return solve_banded((1, 1), banded, right, overwrite_ab=True, overwrite_b=True, check_finite=False)
