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
"""Points that one other motion has to explain: of fewer none is told."""
SAMPLES = 200
"""Of five points, at most: where half of the points move alike, one of so many is of these alone in 998 of 1,000 cases.
Where none moves with the others, a search among 150 takes 5 ms, and ten times as many samples take 27."""
MOST_OF = 0.5
"""Share of those left unexplained that it has to explain: an essential matrix explains a third of any 30 points, and of
fewer up to 60 %."""
MARKED = 0.1
"""Share of all points from which a second motion is a thing of its own and no few tracks gone astray: with 200 points
the least that is told of at all."""


def second_motion(x1: Array, x2: Array, unexplained: NDArray[np.bool_], sigma: float) -> Decision:
    """Of points at normalised coordinates (N, 2) in two views, the share that one other rigid motion explains."""
    return told(rigid(x1[unexplained], x2[unexplained], sigma), len(x1))


def rigid(x1: Array, x2: Array, sigma: float) -> NDArray[np.bool_]:
    """Which of the points at (N, 2) in two views the one motion explains that explains most; none of fewer than LEAST.

    A turn alone is tried first, none at all included: what stands still before a still camera.
    """
    if len(x1) < LEAST:
        return np.zeros(len(x1), bool)
    turn = dominant_rotation(x1, x2, TURN_LOSS * sigma)
    by_turn = np.linalg.norm(rotate(turn, x1) - x2, axis=1) < INLIER * sigma
    found = relative_pose(x1, x2, sigma, SAMPLES)
    return by_turn if found is None or found.inliers.sum() <= by_turn.sum() else found.inliers


def told(explained: NDArray[np.bool_], count: int) -> Decision:
    """Of `count` points in all, those (N,) that one motion leaves unexplained, and another one explains or not."""
    also = int(explained.sum())
    share = also / count if also >= max(LEAST, MOST_OF * len(explained)) else 0.0
    tracks = f"{also} of {count} tracks, {len(explained)} unexplained" if share else ""
    return checks.SECOND_MOTION.of(share, MARKED, tracks)
