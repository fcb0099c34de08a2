"""One trajectory carried onto another where both have poses: its shape stays, its drift becomes the other's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from ispom.geometry import Array
from ispom.types import Trajectory


def anchored(own: Trajectory, anchors: Trajectory) -> Trajectory:
    """`own`, moved so that it meets `anchors` at the times (at least one) that both have; else as it is.

    Between two such times the one correction goes over into the other, linearly in time; before the first and after
    the last it is theirs. Both are of the same frame, their worlds may differ.
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
    # Blending places, not the motions: far from the world's origin a small turn moves much.
    ends = [np.einsum("kij,kj->ki", turns[i], own.translations) + shifts[i] for i in (low, low + 1)]
    return Trajectory(own.times_ns, turned @ own.rotations, (1 - share) * ends[0] + share * ends[1], own.frame)


def averaged(own: Trajectory, anchors: Trajectory, over: int) -> Trajectory:
    """The poses of `anchors` at the times that both have, but for what differs between neighbours: each is where the
    corrections of the `over` nearest (as many before as after it; fewer at the ends) carry that of `own` on average.

    For anchors with errors of their own, where `own` says better how neighbours lie to each other.
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
    """Times (K,) that both have; rotations (K, 3, 3) and translations (K, 3) that carry own poses onto the anchors."""
    common = np.intersect1d(own.times_ns, anchors.times_ns)
    mine = own.select(np.searchsorted(own.times_ns, common))
    theirs = anchors.select(np.searchsorted(anchors.times_ns, common))
    turns = theirs.rotations @ np.swapaxes(mine.rotations, 1, 2)
    return common, turns, theirs.translations - np.einsum("kij,kj->ki", turns, mine.translations)
