"""Paths that turn and bend in all directions, with their exact poses, and questions about them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.evaluation.audit.auditor import Question
from ispom.evaluation.trajectory_error import Alignment, associate
from ispom.geometry import Pose, so3_exp
from ispom.types import Trajectory

AWAY = Pose.from_rotvec(np.array([0.4, -1.1, 0.3]), np.array([5.0, -3, 2]))


def path(seed: int = 0, seconds: float = 30.0, rate_hz: float = 20.0) -> Trajectory:
    """Sums of sines with random frequencies and phases; some metres wide, turning by some tens of degrees."""
    rng = np.random.default_rng([seed, 3])
    times_ns = np.round(np.arange(0, seconds, 1 / rate_hz) * 1e9).astype(np.int64)
    angle = 2 * np.pi * rng.uniform(0.03, 0.25, (4, 6)) * (times_ns * 1e-9)[:, None, None] + rng.uniform(0, 6, (4, 6))
    waves = np.sin(angle).sum(axis=1)
    return Trajectory(times_ns, so3_exp(0.35 * waves[:, 3:]), 1.2 * waves[:, :3])


def noisy(true: Trajectory, seed: int = 0, metres: float = 0.01, degrees: float = 0.3) -> Trajectory:
    """The same path in another world, with independent noise and a drift of 1 % of the path."""
    rng = np.random.default_rng([seed, 4])
    turns = so3_exp(np.radians(degrees) * rng.normal(size=(len(true), 3)))
    steps = np.linalg.norm(np.diff(true.translations, axis=0, prepend=true.translations[:1]), axis=1)
    drift = np.cumsum(0.05 * steps[:, None] * rng.normal(size=(len(true), 3)), axis=0)
    moved = replace(
        true,
        rotations=true.rotations @ turns,
        translations=true.translations + drift + metres * rng.normal(size=(len(true), 3)),
    )
    return moved.moved(left=AWAY)


def question(
    estimate: Trajectory,
    reference: Trajectory,
    alignment: Alignment = "se3",
    timed: bool = True,
    rotations: tuple[bool, bool] = (True, True),
) -> Question:
    def associated(own: Trajectory, other: Trajectory, most_s: float | None) -> tuple[Trajectory, Trajectory]:
        return associate(own, other, round((0.01 if most_s is None else most_s) * 1e9) if timed else 0)

    return Question(estimate, reference, associated, alignment, timed, rotations=rotations)
