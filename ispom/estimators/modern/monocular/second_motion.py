"""Whether what the camera's motion leaves unexplained moves rigidly, too: then the scene may be the other one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.setup import INLIER, TURN_LOSS
from ispom.geometry import Array
from ispom.solvers.multiview.essential import relative_pose
from ispom.solvers.multiview.rotation import dominant_rotation, rotate
from ispom.types import Decision

LEAST = 20
"""Points left unexplained: of fewer no motion is told."""
MOST_OF = 0.5
"""Share of these that one motion has to explain: an essential matrix explains a third of any points."""
MARKED = 0.1
"""Share of all points from which a second motion is a thing of its own and no few tracks gone astray: with 200 points
the least that is told of at all."""


def second_motion(x1: Array, x2: Array, unexplained: NDArray[np.bool_], sigma: float) -> Decision:
    """Of points at normalised coordinates (N, 2) in two views, the share that one other rigid motion explains.

    A turn alone is tried first, none at all included: what stands still before a still camera.
    """
    rest1, rest2 = x1[unexplained], x2[unexplained]
    count = 0
    if len(rest1) >= LEAST:
        turn = dominant_rotation(rest1, rest2, TURN_LOSS * sigma)
        count = int((np.linalg.norm(rotate(turn, rest1) - rest2, axis=1) < INLIER * sigma).sum())
        found = relative_pose(rest1, rest2, sigma)
        count = max(count, 0 if found is None else int(found.inliers.sum()))
    share = count / len(x1) if count >= MOST_OF * len(rest1) else 0.0
    tracks = f"{count} of {len(x1)} tracks, {len(rest1)} unexplained" if share else ""
    return checks.SECOND_MOTION.of(share, MARKED, tracks)
