"""Corrects one trajectory by another at their common times: it keeps its shape, and gets the other's drift."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from ispom.geometry import Array
from ispom.types import Trajectory


def anchored(own: Trajectory, anchors: Trajectory) -> Trajectory:
    """Returns `own`, moved onto `anchors` at their common times; unchanged if there are none.

    Between common times the correction is interpolated linearly; before the first and after the last it is constant.
    Both trajectories are of the same frame; their worlds may differ.
    """
    common, turns, shifts = _corrections(own, anchors)
    if not len(common):
        return own
    if len(common) == 1:
        return Trajectory(own.times_ns, turns[0] @ own.rotations, own.translations @ turns[0].T + shifts[0], own.frame)
    times = np.clip(own.times_ns, common[0], common[-1])
    low = np.clip(np.searchsorted(common, times, side="right") - 1, 0, len(common) - 2)
    share = ((times - common[low]) / (common[low + 1] - common[low]))[:, None]
    turned = Slerp((common - common[0]) * 1e-9, Rotation.from_matrix(turns))((times - common[0]) * 1e-9).as_matrix()
    # Interpolates positions, not corrections: far from the world's origin a small rotation moves a position far.
    ends = [np.einsum("kij,kj->ki", turns[i], own.translations) + shifts[i] for i in (low, low + 1)]
    return Trajectory(own.times_ns, turned @ own.rotations, (1 - share) * ends[0] + share * ends[1], own.frame)


def averaged(own: Trajectory, anchors: Trajectory, over: int) -> Trajectory:
    """Smooths the poses of `anchors` at the common times: each is the pose of `own`, moved by the mean of corrections.

    The mean is over the `over` nearest corrections (as many before as after; fewer at the ends). Suits anchors with
    independent errors, if relative poses of neighbours are more accurate in `own`.
    """
    common, turns, shifts = _corrections(own, anchors)
    mine = own.select(np.searchsorted(own.times_ns, common))
    places, turned = np.zeros_like(shifts), np.zeros_like(shifts)
    count, i = np.zeros((len(common), 1)), np.arange(len(common))
    for k in range(-(over // 2), over // 2 + 1):
        j = np.clip(i + k, 0, max(len(common) - 1, 0))
        use = (j == i + k)[:, None]
        places += use * (np.einsum("kij,kj->ki", turns[j], mine.translations) + shifts[j])
        turned += use * Rotation.from_matrix(turns[j] @ np.swapaxes(turns, 1, 2)).as_rotvec()
        count += use
    rotations = Rotation.from_rotvec(turned / count).as_matrix() @ turns @ mine.rotations
    return Trajectory(common, rotations, places / count, own.frame)


def _corrections(own: Trajectory, anchors: Trajectory) -> tuple[NDArray[np.int64], Array, Array]:
    """Returns the common times (K,), and rotations (K, 3, 3) and translations (K, 3) that map own poses to anchors."""
    common = np.intersect1d(own.times_ns, anchors.times_ns)
    mine = own.select(np.searchsorted(own.times_ns, common))
    theirs = anchors.select(np.searchsorted(anchors.times_ns, common))
    turns = theirs.rotations @ np.swapaxes(mine.rotations, 1, 2)
    return common, turns, theirs.translations - np.einsum("kij,kj->ki", turns, mine.translations)
