"""Whether images were mirrored, as a path against its ground truth shows it.

A mirrored film shows a mirrored world, and no image tells which one is real. In it a camera that turns to the left
turns to the right, while it goes ahead as before: with M the mirror, d' = M d for steps and w' = det(M) M w for
rotation vectors, both in the camera's frame. Neither another world nor another convention of the axes does both.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ispom.evaluation.trajectory_error import associate
from ispom.geometry import Array, so3_log
from ispom.types import Rig, Trajectory

MIRRORS: Mapping[str, tuple[float, float, float]] = {"left-right": (-1, 1, 1), "top-bottom": (1, -1, 1)}
"""What M does to the camera's axes, by the words for it."""
LAGS = (0.1, 0.2, 0.4)
"""Parts of the path between two poses that are compared."""
LEAST_POSES = 15
LEAST_TURN_RAD = np.radians(1.5)
"""Root mean square of the rotations that the mirror changes, from which on they say anything."""
BETTER = 4.0
"""How many times better rotations and steps must fit mirrored than as they are."""
FITS = 0.35
"""Misfit of mirrored rotations and of mirrored steps, relative to their size, at most."""


def mirrored(estimate: Trajectory, world_from_rig: Trajectory, rig: Rig) -> str:
    """Returns "left-right" or "top-bottom" where the path is that of mirrored images; "" where it is not, or where the
    path cannot tell. The unit of the estimate does not matter."""
    truth = world_from_rig.moved(right=rig.rig_from(estimate.frame), frame=estimate.frame)
    own, true = associate(estimate, truth)
    if len(own) < LEAST_POSES:
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
    if _rms(turned - true_turn) / 2 < LEAST_TURN_RAD:
        return False
    misfit = _rms(turn - turned) / _rms(turned)
    step_misfit, as_they_are = (_misfit(step, true_step * signs) for signs in (mirror, np.ones(3)))
    return bool(
        misfit < FITS
        and step_misfit < FITS
        and _rms(turn - true_turn) > BETTER * _rms(turn - turned)
        and as_they_are > step_misfit
    )


def _motions(path: Trajectory, lag: int) -> tuple[Array, Array]:
    """Returns rotation vectors and steps (N, 3) from each pose to one `lag` poses later, in the camera's own frame."""
    back = np.swapaxes(path.rotations[:-lag], 1, 2)
    steps = path.translations[lag:] - path.translations[:-lag]
    return so3_log(back @ path.rotations[lag:]), np.einsum("nij,nj->ni", back, steps)


def _misfit(step: Array, expected: Array) -> float:
    """Returns the misfit of steps in any unit, relative to their size: 1 where they have nothing in common."""
    size = float((step**2).sum())
    if size == 0 or not expected.any():
        return 1.0
    scale = max(float((step * expected).sum()) / float((expected**2).sum()), 0.0)
    return float(np.sqrt(((step - scale * expected) ** 2).sum() / size))


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).sum(axis=1).mean()))
