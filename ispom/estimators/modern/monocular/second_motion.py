"""Checks whether the outliers of the camera's motion move rigidly as well: then the scene may be the other motion."""

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
"""Largest number of samples of five points: if half of the points move together, one of 200 samples contains only these
in 998 of 1,000 cases. If none do, a search among 150 takes 5 ms, and ten times as many samples take 27."""


def second_motion(x1: Array, x2: Array, unexplained: NDArray[np.bool_], width: float) -> Decision:
    """Checks the share of points, at normalised coordinates (N, 2) in two views, that one other rigid motion explains.

    `width` of the robust loss, normalised.
    """
    return second_motion_decision(rigid(x1[unexplained], x2[unexplained], width), len(x1))


def rigid(x1: Array, x2: Array, width: float) -> NDArray[np.bool_]:
    """Returns which of the points (N, 2) in two views the best rigid motion explains; none of fewer than LEAST.

    A pure rotation is tried first; it includes no motion at all, of a static object before a static camera.
    """
    if len(x1) < LEAST:
        return np.zeros(len(x1), bool)
    turn = dominant_rotation(x1, x2, TURN_LOSS * width)
    by_turn = np.linalg.norm(rotate(turn, x1) - x2, axis=1) < INLIER * width
    found = relative_pose(x1, x2, width, SAMPLES)
    return by_turn if found is None or found.inliers.sum() <= by_turn.sum() else found.inliers
