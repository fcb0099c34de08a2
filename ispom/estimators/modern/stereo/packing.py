"""The observations of the window's key frames, sorted for its adjustment."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.kernels import kernel
from ispom.numerics.vectors import matrix, plus, times, vector
from ispom.solvers.right_camera import BOTH_K1, BOTH_K2, COLUMNS, LAG, drift_of, fill_ideal_column, lens_removed


class Packed(NamedTuple):
    """Of K observations of M points: those that are seen at least twice. A point seen once says nothing: with a
    disparity it has as many unknowns as observations."""

    used: NDArray[np.int64]
    """(M,) which of the map's points, ascending."""
    cameras: NDArray[np.int64]
    """(K,) key frame of each observation; sorted by point, those of a point by key frame."""
    owners: NDArray[np.int64]
    """(K,) which of `used`."""
    origin: NDArray[np.int64]
    """(K,) where in its key frame."""
    seen: Array
    """(K, 3)."""
    factors: Array
    """(K, COLUMNS) see right_camera.by_column."""


@kernel()
def pack(known, xyz, ids, sizes, seen, rotations, translations, rates, extra, baseline):
    """Points of the map `known` (P,) ascending, at `xyz` (P, 3); key frames with `sizes` (C,) of `ids` (N,), ascending
    in each, `seen` (N, 3), at poses (C, 3, 3) and (C, 3), moving at `rates` (C, 6); `extra` (E,) is wrong with the
    pair."""
    place, count = np.full(len(ids), -1), np.zeros(len(known), np.int64)
    begin = 0
    for c in range(len(sizes)):
        p = 0
        for i in range(begin, begin + sizes[c]):
            while p < len(known) and known[p] < ids[i]:
                p += 1
            if p < len(known) and known[p] == ids[i]:
                place[i] = p
                count[p] += 1
        begin += sizes[c]
    # where the observations of each point begin
    first, owner, total, points = np.full(len(known), -1), np.empty(len(known), np.int64), 0, 0
    for p in range(len(known)):
        if count[p] >= 2:
            first[p], owner[p] = total, points
            total += count[p]
            points += 1
    out = Packed(
        np.empty(points, np.int64), np.empty(total, np.int64), np.empty(total, np.int64), np.empty(total, np.int64),
        np.empty((total, 3)), np.zeros((total, COLUMNS)),
    )  # fmt: skip
    begin = 0
    for c in range(len(sizes)):
        for i in range(begin, begin + sizes[c]):
            p = place[i]
            if p < 0 or first[p] < 0:
                continue
            k = first[p]
            first[p] += 1
            out.used[owner[p]], out.owners[k], out.cameras[k], out.origin[k] = p, owner[p], c, i - begin
            near = plus(times(matrix(rotations, c), vector(xyz, p)), vector(translations, c))
            late = drift_of(near, rates, c, extra[LAG], baseline)
            x, y, right = vector(seen, i)
            out.seen[k, 0], out.seen[k, 1], out.seen[k, 2] = x, y, right
            x, y = lens_removed(x, y, extra[BOTH_K1], extra[BOTH_K2])
            fill_ideal_column(out.factors, k, x, y, right, extra, late[0])
        begin += sizes[c]
    return out
