"""Detects mirrored images by comparing a path with its ground truth.

A mirrored film shows a mirrored world, which cannot be recognised from the images. A left turn of the camera becomes a
right turn, while forward motion stays forward: with the mirror M, d' = M d for displacements and w' = det(M) M w for
rotation vectors, both in the camera's frame. No other world frame or convention of axes has both effects.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ispom.evaluation.trajectory_error import associate
from ispom.geometry import Array, so3_log
from ispom.types import Rig, Trajectory

MIRRORS: Mapping[str, tuple[float, float, float]] = {"left-right": (-1, 1, 1), "top-bottom": (1, -1, 1)}
"""Factors of the camera's axes, the diagonal of M, by name."""
LAGS = (0.1, 0.2, 0.4)
"""Distances between two compared poses, relative to the number of poses of the path."""
MIN_POSES = 15
"""Least number of associated poses for a judgement."""
MIN_ROTATION_RAD = np.radians(1.5)
"""Least root mean square of the rotations that the mirror would change."""
MIN_GAIN = 4.0
"""Least ratio of the misfits of rotations and displacements without and with the mirror."""
MAX_MISFIT = 0.35
"""Largest misfit of mirrored rotations and of mirrored displacements, relative to their size."""


def mirrored(estimate: Trajectory, world_from_rig: Trajectory, rig: Rig) -> str:
    """Returns "left-right" or "top-bottom" for the path of mirrored images; "" for other paths, and if the motion does
    not determine it. The estimate may have any scale."""
    truth = world_from_rig.moved(right=rig.rig_from(estimate.frame), frame=estimate.frame)
    own, true = associate(estimate, truth)
    if len(own) < MIN_POSES:
        return ""
    for words, signs in MIRRORS.items():
        mirror = np.array(signs)
        by_lag = [_is_mirrored(own, true, max(1, round(lag * len(own))), mirror) for lag in LAGS]
        if all(by_lag):
            return words
    return ""


def _is_mirrored(own: Trajectory, true: Trajectory, lag: int, mirror: Array) -> bool:
    (turn, step), (true_turn, true_step) = (_motions(each, lag) for each in (own, true))
    turned = np.prod(mirror) * mirror * true_turn
    if _rms(turned - true_turn) / 2 < MIN_ROTATION_RAD:
        return False
    misfit = _rms(turn - turned) / _rms(turned)
    step_misfit, as_they_are = (_misfit(step, true_step * signs) for signs in (mirror, np.ones(3)))
    return bool(
        misfit < MAX_MISFIT
        and step_misfit < MAX_MISFIT
        and _rms(turn - true_turn) > MIN_GAIN * _rms(turn - turned)
        and as_they_are > step_misfit
    )


def _motions(path: Trajectory, lag: int) -> tuple[Array, Array]:
    """Returns rotation vectors and steps (N, 3) from each pose to one `lag` poses later, in the camera's own frame."""
    back = np.swapaxes(path.rotations[:-lag], 1, 2)
    steps = path.translations[lag:] - path.translations[:-lag]
    return so3_log(back @ path.rotations[lag:]), np.einsum("nij,nj->ni", back, steps)


def _misfit(step: Array, expected: Array) -> float:
    """Returns the misfit of displacements in any unit, relative to their size: 1 for unrelated ones."""
    size = float((step**2).sum())
    if size == 0 or not expected.any():
        return 1.0
    scale = max(float((step * expected).sum()) / float((expected**2).sum()), 0.0)
    return float(np.sqrt(((step - scale * expected) ** 2).sum() / size))


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).sum(axis=1).mean()))
