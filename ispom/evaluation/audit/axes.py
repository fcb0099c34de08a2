"""Checks whether both trajectories are of a body with the same axes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.audit.blocks import Errors, errors, groups_of, levels, world_rotation
from ispom.evaluation.audit.correction import Correction
from ispom.evaluation.audit.explanation import SIGNIFICANT, Explanation, Scene, held_out, jackknife_sigma
from ispom.evaluation.audit.samples import Samples
from ispom.geometry import Array, Pose, rotation_angle_rad, so3_log

MIN_TURN_RAD = np.radians(5.0)
"""Least angle between the axes of two bodies that is called another convention; a smaller one is an error of a mount's
calibration."""
ITERATIONS = 8
"""Iterations of the alternating fits of the turn and of the worlds, which converge in three to five."""


def axes(scene: Scene, before: Samples) -> Iterator[Explanation]:
    """Returns the explanation by other axes, where both have rotations."""
    if before.rotations is not None:
        yield _axes(scene, before)


def turned(samples: Samples, turn: Array) -> Samples:
    """Samples of a body with other axes; `turn` (3, 3) is own_from_true."""
    assert samples.own_rotations is not None
    return samples.moved(samples.own, samples.own_rotations @ turn)


def fitted_turn(samples: Samples, starts: NDArray[np.intp], with_scale: bool, preferred: Array | None = None) -> Array:
    """Returns the rotation (3, 3) own_body_from_true_body that fits all rotations, one world rotation per block.

    Motions about one axis only do not determine it; the rotation of the world that the positions determine decides
    then, or the one that fits as well as any other and is nearest to the `preferred` one.
    """
    assert samples.rotations is not None
    own, true = samples.rotations
    of_block = np.repeat(np.arange(len(starts)), np.diff(np.append(starts, len(own))))
    world = world_rotation(samples, with_scale)
    seeds = [np.eye(3), _from_motions(own, true)]
    if world is not None:
        tied = _nearest((np.swapaxes(own, 1, 2) @ world.T @ true).sum(axis=0))
        seeds = [tied, *seeds]
    if preferred is not None:
        seeds = [preferred, *seeds]
    found = []
    for seed in seeds:
        turn = seed
        for _ in range(ITERATIONS):
            worlds = _nearest(np.add.reduceat(true @ turn.T @ np.swapaxes(own, 1, 2), starts))
            turn = _nearest((np.swapaxes(own, 1, 2) @ np.swapaxes(worlds, 1, 2)[of_block] @ true).sum(axis=0))
        found.append((float((worlds[of_block] @ own @ turn - true).__pow__(2).sum()), turn))
    best = min(left for left, _ in found)
    # The first seed is the one that agrees with the positions: it wins where the rotations do not decide.
    return next(turn for left, turn in found if left <= 1.1 * best + 1e-9)


def _from_motions(own: Array, true: Array) -> Array:
    """Returns own_from_true of rotation vectors of the motions over a fiftieth of the path (Kabsch)."""
    lag = max(len(own) // 50, 1)
    mine, theirs = (so3_log(np.swapaxes(r[:-lag], 1, 2) @ r[lag:]) for r in (own, true))
    return _nearest(mine.T @ theirs)


def _nearest(matrices: Array) -> Array:
    """Returns the rotations (..., 3, 3) nearest to matrices."""
    u, _, vt = np.linalg.svd(matrices)
    u[..., 2] *= np.where(np.linalg.det(u) * np.linalg.det(vt) > 0, 1.0, -1.0)[..., None]
    return u @ vt


def _axes(scene: Scene, before: Samples) -> Explanation:
    gains, after, turns, sigmas = [], [], [], []
    for starts in levels(len(before)):
        group = groups_of(len(starts))
        of_sample = np.repeat(group, np.diff(np.append(starts, len(before))))
        turn, fits = fitted_turn(before, starts, scene.with_scale), []
        for g in np.unique(group):
            rest = before.select(of_sample != g)
            fits.append(fitted_turn(rest, _starts_without(starts, group, g, len(before)), scene.with_scale, turn))
        vectors = np.array([so3_log(turn.T @ fit) for fit in fits])

        def at(vector: Array, turn: Array = turn, starts: NDArray[np.intp] = starts) -> Errors:
            change = Pose.from_rotvec(vector, np.zeros(3)).rotation
            return errors(turned(before, turn @ change), starts, scene.with_scale)

        left = held_out(at, vectors, group)
        gains.append(errors(before, starts, scene.with_scale).gain(left))
        after.append(left)
        turns.append(turn)
        sigmas.append(float(np.linalg.norm(jackknife_sigma(vectors))))
        if len(gains) == 3:  # finer blocks determine a turn no better
            break
    best = int(np.argmax([gain.mean() for gain in gains]))
    angle = float(rotation_angle_rad(turns[best]))
    return Explanation(
        "axes",
        Correction(body=Pose(turns[best], np.zeros(3))),
        tuple(gains),
        tuple(after),
        3,
        {"turn_deg": float(np.degrees(angle))},
        {"turn_deg": float(np.degrees(sigmas[best]))},
        angle >= max(MIN_TURN_RAD, SIGNIFICANT * sigmas[best]),
    )


def _starts_without(starts: NDArray[np.intp], group: NDArray[np.intp], left_out: int, count: int) -> NDArray[np.intp]:
    """Returns the first samples of the blocks once those of a group are gone."""
    lengths = np.diff(np.append(starts, count))[group != left_out]
    return np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.intp)
