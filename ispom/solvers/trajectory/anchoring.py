"""One trajectory carried onto another where both have poses: its shape stays, its drift becomes the other's."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from ispom.types import Trajectory


def anchored(own: Trajectory, anchors: Trajectory) -> Trajectory:
    """`own`, moved so that it meets `anchors` at the times (at least one) that both have; else as it is.

    Between two such times the one correction goes over into the other, linearly in time; before the first and after
    the last it is theirs. Both are of the same frame, their worlds may differ.
    """
    common = np.intersect1d(own.times_ns, anchors.times_ns)
    if not len(common):
        return own
    mine = own.select(np.searchsorted(own.times_ns, common))
    theirs = anchors.select(np.searchsorted(anchors.times_ns, common))
    turns = theirs.rotations @ np.swapaxes(mine.rotations, 1, 2)
    shifts = theirs.translations - np.einsum("kij,kj->ki", turns, mine.translations)
    if len(common) == 1:
        return Trajectory(own.times_ns, turns[0] @ own.rotations, own.translations @ turns[0].T + shifts[0], own.frame)
    times = np.clip(own.times_ns, common[0], common[-1])
    low = np.clip(np.searchsorted(common, times, side="right") - 1, 0, len(common) - 2)
    share = ((times - common[low]) / (common[low + 1] - common[low]))[:, None]
    turned = Slerp((common - common[0]) * 1e-9, Rotation.from_matrix(turns))((times - common[0]) * 1e-9).as_matrix()
    # Blending places, not the motions: far from the world's origin a small turn moves much.
    ends = [np.einsum("kij,kj->ki", turns[i], own.translations) + shifts[i] for i in (low, low + 1)]
    return Trajectory(own.times_ns, turned @ own.rotations, (1 - share) * ends[0] + share * ends[1], own.frame)
