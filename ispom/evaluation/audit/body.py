"""Asks whether both trajectories are of the same body: its axes, and the lever arm between two bodies on one rig."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.audit.blocks import Errors, errors, groups_of, levels, residuals, world_rotation
from ispom.evaluation.audit.correction import Correction
from ispom.evaluation.audit.explanation import SIGNIFICANT, Explanation, Scene, held_out, jackknife_sigma
from ispom.evaluation.audit.samples import Samples
from ispom.geometry import Array, Pose, rotation_angle_rad, so3_log

MIN_TURN_RAD = np.radians(5.0)
"""Least angle between the axes of two bodies that is called another convention; a smaller one is an error of a mount's
calibration."""
ITERATIONS = 8
"""Of the alternating fits of a turn, and of Gauss-Newton for a lever arm, which converge in three to five."""
STEP = 1e-4
"""Step of numeric derivatives of a lever arm, relative to the path's extent."""


def body(scene: Scene, before: Samples) -> Iterator[Explanation]:
    """Returns the explanations by other axes, and by a lever arm."""
    if before.rotations is not None:
        yield _axes(scene, before)
    if before.own_rotations is not None or before.true_rotations is not None:
        yield _lever_arm(scene, before)


def turned(samples: Samples, turn: Array) -> Samples:
    """Samples of a body with other axes; `turn` (3, 3) is own_from_true."""
    assert samples.own_rotations is not None
    return samples.moved(samples.own, samples.own_rotations @ turn)


def fitted_turn(samples: Samples, starts: NDArray[np.intp], with_scale: bool) -> Array:
    """Returns the rotation (3, 3) own_body_from_true_body that fits all rotations, one world rotation per block.

    Motions about one axis only do not determine it; the rotation of the world that the positions determine decides
    then.
    """
    assert samples.rotations is not None
    own, true = samples.rotations
    of_block = np.repeat(np.arange(len(starts)), np.diff(np.append(starts, len(own))))
    world = world_rotation(samples, with_scale)
    seeds = [np.eye(3), _from_motions(own, true)]
    if world is not None:
        tied = _nearest((np.swapaxes(own, 1, 2) @ world.T @ true).sum(axis=0))
        seeds = [tied, *seeds]
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
        fits = []
        for g in np.unique(group):
            rest = before.select(of_sample != g)
            fits.append(fitted_turn(rest, _starts_without(starts, group, g, len(before)), scene.with_scale))
        turn = fitted_turn(before, starts, scene.with_scale)
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


def with_lever_arm(samples: Samples, arm: Array) -> Samples:
    """Samples of the body at `arm` (3,) in the estimate's body; in the reference's, where only that has rotations."""
    if samples.own_rotations is not None:
        return samples.moved(samples.own + samples.own_rotations @ arm, samples.own_rotations)
    assert samples.true_rotations is not None
    return replace(samples, true=samples.true - samples.true_rotations @ arm)


def _lever_arm(scene: Scene, before: Samples) -> Explanation:
    gains, after, arms, sigmas = [], [], [], []
    for starts in levels(len(before)):
        arm, fits = _fitted_arm(before, starts, scene.with_scale)

        def at(vector: Array, starts: NDArray[np.intp] = starts) -> Errors:
            return errors(with_lever_arm(before, vector), starts, scene.with_scale)

        left = held_out(at, fits, groups_of(len(starts)))
        gains.append(errors(before, starts, scene.with_scale).gain(left))
        after.append(left)
        arms.append(arm)
        sigmas.append(jackknife_sigma(fits))
    best = int(np.argmax([gain.mean() for gain in gains]))
    arm, sigma = arms[best], sigmas[best]
    in_estimate = before.own_rotations is not None
    body = Pose(np.eye(3), arm) if in_estimate else None
    length = float(np.linalg.norm(arm))
    along = float(np.sqrt(((arm * sigma) ** 2).sum()) / max(length, 1e-12))
    values = {f"lever_{axis}": float(value) for axis, value in zip("xyz", arm, strict=True)}
    deviations = {f"lever_{axis}": float(value) for axis, value in zip("xyz", sigma, strict=True)}
    return Explanation(
        "lever_arm",
        Correction(body=body),
        tuple(gains),
        tuple(after),
        3,
        {"lever": length, **values},
        {"lever": along, **deviations},
        length >= SIGNIFICANT * along,
    )


def _fitted_arm(samples: Samples, starts: NDArray[np.intp], with_scale: bool) -> tuple[Array, Array]:
    """Returns the lever arm (3,), and those (G, 3) without each group of blocks, by Gauss-Newton.

    Each block has its own noise: its residuals weigh by the inverse of their variance.
    """
    counts = np.diff(np.append(starts, len(samples)))
    of_block = np.repeat(np.arange(len(starts)), counts)
    extent = float(np.sqrt(((samples.true - samples.true.mean(axis=0)) ** 2).sum(axis=1).mean()))
    arm, step = np.zeros(3), STEP * max(extent, 1e-9)
    floor = (1e-5 * extent) ** 2 + 1e-30

    def left(vector: Array) -> Array:
        moved = with_lever_arm(samples, vector)
        return residuals(moved.own, moved.true, starts, with_scale)

    hessian = gradient = np.zeros(0)
    for _ in range(ITERATIONS):
        now = left(arm)
        slopes = np.stack([(left(arm + step * e) - left(arm - step * e)) / (2 * step) for e in np.eye(3)], axis=-1)
        variance = np.add.reduceat((now**2).sum(axis=1), starts) / counts + floor
        weighed = slopes / variance[of_block][:, None, None]
        hessian = np.add.reduceat(np.einsum("nij,nik->njk", weighed, slopes), starts)
        gradient = np.add.reduceat(np.einsum("nij,ni->nj", weighed, now), starts)
        change = _solved(hessian.sum(axis=0), gradient.sum(axis=0))
        arm = arm - change
        if np.linalg.norm(change) <= 1e-6 * extent:
            break
    group = groups_of(len(starts))
    fits = []
    for g in np.unique(group):
        rest = group != g
        fits.append(arm - _solved(hessian[rest].sum(axis=0), gradient[rest].sum(axis=0)))
    return arm, np.array(fits)


def _solved(hessian: Array, gradient: Array) -> Array:
    """Directions that no rotation shows, such as the axis of a car's, stay zero."""
    return np.linalg.pinv(hessian, rcond=1e-4, hermitian=True) @ gradient
