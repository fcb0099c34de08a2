"""Whether what the camera's motion leaves unexplained moves rigidly, too: then the scene may be the other one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.monocular.setup import INLIER, TURN_LOSS
from ispom.estimators.modern.motions import LEAST, second_motion_decision
from ispom.geometry import Array
from ispom.solvers.multiview.essential import relative_pose
from ispom.solvers.multiview.rotation import dominant_rotation, rotate
from ispom.types import Decision

SAMPLES = 200
"""Of five points, at most: where half of the points move alike, one of so many is of these alone in 998 of 1,000 cases.
Where none moves with the others, a search among 150 takes 5 ms, and ten times as many samples take 27."""


def second_motion(x1: Array, x2: Array, unexplained: NDArray[np.bool_], width: float) -> Decision:
    """Of points at normalised coordinates (N, 2) in two views, the share that one other rigid motion explains.

    `width` of the robust loss, normalised.
    """
    return second_motion_decision(rigid(x1[unexplained], x2[unexplained], width), len(x1))


def rigid(x1: Array, x2: Array, width: float) -> NDArray[np.bool_]:
    """Which of the points at (N, 2) in two views the one motion explains that explains most; none of fewer than LEAST.

    A turn alone is tried first, none at all included: what stands still before a still camera.
    """
    if len(x1) < LEAST:
        return np.zeros(len(x1), bool)
    turn = dominant_rotation(x1, x2, TURN_LOSS * width)
    by_turn = np.linalg.norm(rotate(turn, x1) - x2, axis=1) < INLIER * width
    found = relative_pose(x1, x2, width, SAMPLES)
    return by_turn if found is None or found.inliers.sum() <= by_turn.sum() else found.inliers
