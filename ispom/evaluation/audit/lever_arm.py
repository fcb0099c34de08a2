"""Checks whether both trajectories are of the same point of a rig: the lever arm between two bodies.

Blocks whose positions are aligned show it whatever the axes are, but their alignment takes a part of it away. Motions
in the body's own frame show it better, where the axes are the same: turning moves a point that is far from the axis.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.audit.blocks import Errors, errors, groups_of, levels, residuals
from ispom.evaluation.audit.correction import Correction
from ispom.evaluation.audit.explanation import (
    MIN_GAIN,
    MIN_GROUPS,
    MIN_GROUPS_BETTER,
    NO_WORSE,
    Explanation,
    held_out,
    jackknife_sigma,
)
from ispom.evaluation.audit.samples import Samples
from ispom.geometry import Array, Pose, skew
from ispom.solvers.trajectory.alignment import umeyama

ITERATIONS = 8
"""Iterations of Gauss-Newton, which converges in three to five."""
STEP = 1e-4
"""Step of numeric derivatives of a lever arm, relative to the path's extent."""
REWEIGHTED = 4
"""Number of times that the weights of a robust fit are computed again."""
LAGS = (8, 16, 32)
"""Numbers of samples from the start of a motion to its end."""
MIN_MOTIONS = 0.05
"""Least share of the motions that a lever arm must change by more than their median error: it does not show on a
straight road."""
CLEARLY = 5.0
"""Least size of a component along an axis, in standard deviations between groups. A weakly determined axis, such as the
vertical one of a car, absorbs other errors, which are similar in all groups."""
MIN_LEFT = 0.05
"""Least part of the change by a lever arm that must remain after an alignment with scale."""
NUISANCE, ARM = 4, slice(4, 7)
"""Columns of the differences between any two calibrations (scale, and a small rotation), and of the lever arm."""


@dataclass(frozen=True, eq=False)
class Motions:
    """The lever arm by motions in the body's frame."""

    arm: Array
    """(3,)."""
    sigma: Array
    """(3,)."""
    shown: float
    """Mean logarithm of the errors before over those after, of motions that the lever arm changes."""
    named: bool


def lever_arm(before: Samples) -> Iterator[Explanation]:
    """Returns the explanation by a lever arm, where one of both has rotations."""
    if before.own_rotations is not None or before.true_rotations is not None:
        yield _lever_arm(before)


def by_motions(samples: Samples, lag: int) -> Motions | None:
    """Fits displacements in the body's frame: true = s own + theta x own + (R - 1) arm, with R the turn of the motion.

    The groups of motions are held out one by one. None without rotations, and with too few samples.
    """
    if samples.rotations is None or len(samples) < 4 * lag:
        return None
    design, true = _displacements(samples, lag)
    weights = _weights(design, true)
    whole = _least_squares(design, true, weights)
    before, after, fits = _held_out_errors(design, true, weights)
    changed = np.linalg.norm(design[:, :, ARM] @ whole[ARM], axis=1) > np.median(before)
    floor = 1e-3 * float(np.median(before)) + 1e-12
    gain, group = np.log((before[changed] + floor) / (after[changed] + floor)), groups_of(len(true))[changed]
    by_group = np.array([gain[group == g].mean() for g in np.unique(group)])
    shown = float(gain.mean()) if len(gain) else 0.0
    named = (
        changed.mean() >= MIN_MOTIONS
        and shown >= MIN_GAIN
        and len(by_group) >= MIN_GROUPS
        and (by_group >= NO_WORSE).mean() >= MIN_GROUPS_BETTER
    )
    sigma = jackknife_sigma(fits)
    determined = abs(whole[ARM]) >= CLEARLY * sigma
    scale = whole[0] if whole[0] > 0 else 1.0
    return Motions(whole[ARM] * determined / scale, sigma / scale, shown, bool(named and determined.any()))


def _displacements(samples: Samples, lag: int) -> tuple[Array, Array]:
    """Returns the design (N, 3, 7) of displacements over `lag` samples, and those of the reference (N, 3)."""
    assert samples.rotations is not None
    own_rotations, true_rotations = samples.rotations
    first = np.arange(0, len(samples) - lag, max(1, lag // 4))
    last = first + lag
    back, true_back = np.swapaxes(own_rotations[first], 1, 2), np.swapaxes(true_rotations[first], 1, 2)
    own = np.einsum("nij,nj->ni", back, samples.own[last] - samples.own[first])
    true = np.einsum("nij,nj->ni", true_back, samples.true[last] - samples.true[first])
    return np.concatenate([own[:, :, None], -skew(own), back @ own_rotations[last] - np.eye(3)], axis=2), true


def _weights(design: Array, true: Array) -> Array:
    """Returns weights (N,) of a robust fit: Cauchy's, with the median residual as width."""
    weights = np.ones(len(true))
    for _ in range(REWEIGHTED):
        left = np.linalg.norm(true - design @ _least_squares(design, true, weights), axis=1)
        weights = 1 / (left**2 + np.median(left) ** 2 + 1e-18)
    return weights


def _held_out_errors(design: Array, true: Array, weights: Array) -> tuple[Array, Array, Array]:
    """Returns errors (N,) without and with a lever arm, fitted to the other groups, and the arms (G, 3) of these."""
    group, before, after, arms = groups_of(len(true)), np.zeros(len(true)), np.zeros(len(true)), []
    for g in np.unique(group):
        rest, mine = group != g, group == g
        plain = _least_squares(design[rest][:, :, :NUISANCE], true[rest], weights[rest])
        fit = _least_squares(design[rest], true[rest], weights[rest])
        before[mine] = np.linalg.norm(true[mine] - design[mine][:, :, :NUISANCE] @ plain, axis=1)
        after[mine] = np.linalg.norm(true[mine] - design[mine] @ fit, axis=1)
        arms.append(fit[ARM])
    return before, after, np.array(arms)


def _least_squares(design: Array, true: Array, weights: Array) -> Array:
    """Returns parameters (K,) of displacements (N, 3) with design (N, 3, K) and weights (N,)."""
    root = np.repeat(np.sqrt(weights), 3)
    columns = design.reshape(-1, design.shape[2]) * root[:, None]
    return np.linalg.lstsq(columns, true.ravel() * root, rcond=1e-4)[0]


def with_lever_arm(samples: Samples, arm: Array) -> Samples:
    """Samples of the body at `arm` (3,) in the estimate's body; in the reference's, where only that has rotations."""
    if samples.own_rotations is not None:
        return samples.moved(samples.own + samples.own_rotations @ arm, samples.own_rotations)
    assert samples.true_rotations is not None
    return replace(samples, true=samples.true - samples.true_rotations @ arm)


def _no_scale(samples: Samples, arm: Array) -> bool:
    """Checks that a lever arm moves positions in a way that no alignment takes away.

    On a circle a lever arm is a scale, and a larger circle makes the same noise a smaller error.
    """
    moved = with_lever_arm(samples, arm)
    pairs = ((samples.own, moved.own), (samples.true, moved.true))
    own, other = max(pairs, key=lambda pair: float(abs(pair[1] - pair[0]).max()))
    change = other - own - (other - own).mean(axis=0)
    left = umeyama(own, other, True).apply(own) - other
    return bool((left**2).sum() > MIN_LEFT**2 * (change**2).sum())


def _lever_arm(before: Samples) -> Explanation:
    """Returns the explanation by a lever arm. Blocks are aligned with a scale even if the requested alignment has none,
    so that a small error of the scale does not look like a lever arm."""
    gains, after, arms, sigmas = [], [], [], []
    for starts in levels(len(before)):
        arm, fits = _fitted_arm(before, starts, True)

        def at(vector: Array, starts: NDArray[np.intp] = starts) -> Errors:
            return errors(with_lever_arm(before, vector), starts, True)

        left = held_out(at, fits, groups_of(len(starts)))
        gains.append(errors(before, starts, True).gain(left))
        after.append(left)
        arms.append(arm)
        sigmas.append(jackknife_sigma(fits))
    best = int(np.argmax([gain.mean() for gain in gains]))
    arm, sigma, shown = arms[best], sigmas[best], None
    motions = [found for lag in LAGS if (found := by_motions(before, lag)) is not None and found.named]
    if motions:
        clearest = max(motions, key=lambda found: found.shown)
        arm, sigma, shown = clearest.arm, clearest.sigma, clearest.shown
    length = float(np.linalg.norm(arm))
    along = float(np.sqrt(((arm * sigma) ** 2).sum()) / max(length, 1e-12))
    values = {f"lever_{axis}": float(value) for axis, value in zip("xyz", arm, strict=True)}
    deviations = {f"lever_{axis}": float(value) for axis, value in zip("xyz", sigma, strict=True)}
    return Explanation(
        "lever_arm",
        Correction(body=Pose(np.eye(3), arm)) if before.own_rotations is not None else Correction(),
        tuple(gains),
        tuple(after),
        3,
        {"lever": length, **values},
        {"lever": along, **deviations},
        length > 0 and _no_scale(before, arm),
        shown,
    )


def _fitted_arm(samples: Samples, starts: NDArray[np.intp], with_scale: bool) -> tuple[Array, Array]:
    """Returns the lever arm (3,), and those (G, 3) without each group of blocks, by Gauss-Newton.

    It is zero along directions that are not determined, such as the vertical one of a car's. Each block has its own
    noise: its residuals weigh by the inverse of their variance.
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
    axes = np.linalg.eigh(hessian.sum(axis=0))[1]
    along, each = arm @ axes, np.array(fits) @ axes
    determined = abs(along) >= CLEARLY * jackknife_sigma(each)
    return (along * determined) @ axes.T, (each * determined) @ axes.T


def _solved(hessian: Array, gradient: Array) -> Array:
    """Directions that no rotation shows, such as the axis of a car's, stay zero."""
    return np.linalg.pinv(hessian, rcond=1e-4, hermitian=True) @ gradient
