"""Bundle adjustment of the doctor's scene with a few numbers of the calibration, and what held-out points say of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ispom.geometry import Array
from ispom.types import Rig

from .hypothesis import STEPS, Change, change_of
from .scene import Observations, Predicted, Scene, predicted

AS_STATED = Change()
LOSS_PX = 0.5
"""Width of the Cauchy loss: corners are followed to about a third of it."""
WIDE_PX = (8.0, 2.0)
"""Widths of the loss before it, from that of the errors that a wrong calibration makes downwards."""
ITERATIONS = 8
POINT_ITERATIONS = 5
ENOUGH = 1e-3
"""Relative decrease of the cost at which an adjustment ends."""
FARTHEST = 100.0
"""Error [px] of a point that a camera cannot see."""


def costs(residuals: Array, loss_px: float = LOSS_PX) -> Array:
    """Returns the robust cost (N,) of residuals (N, 2)."""
    squares = np.nan_to_num((residuals**2).sum(axis=1), nan=FARTHEST**2)
    return np.log1p(np.minimum(squares, FARTHEST**2) / loss_px**2)


def adjust_gradually(
    scene: Scene, rig: Rig, seen: Observations, names: tuple[str, ...] = (), iterations: int = ITERATIONS
) -> tuple[Scene, Change, float]:
    """Does as `adjust`, but with wide losses first.

    A wrong calibration moves all observations of a camera by several pixels. To a narrow loss they are outliers, and it
    leaves them where they are instead of looking for what moved them.
    """
    values = np.zeros(len(names))
    for loss_px in WIDE_PX:
        scene, values, _ = _adjusted(scene, rig, seen, names, values, iterations, loss_px)
    scene, values, cost = _adjusted(scene, rig, seen, names, values, iterations, LOSS_PX)
    return scene, change_of(names, values), cost


def adjust(
    scene: Scene,
    rig: Rig,
    seen: Observations,
    names: tuple[str, ...] = (),
    iterations: int = ITERATIONS,
    first: Change = AS_STATED,
) -> tuple[Scene, Change, float]:
    """Returns the scene and the change of the calibration (in `names` only, from `first` on) that fit best, and their
    cost.

    Levenberg and Marquardt with a Cauchy loss; the first pose is fixed, and damping holds the scale where nothing else
    does.
    """
    values = np.array([first.value(name) for name in names])
    scene, values, cost = _adjusted(scene, rig, seen, names, values, iterations, LOSS_PX)
    return scene, change_of(names, values), cost


def uncertainties(scene: Scene, rig: Rig, seen: Observations, names: tuple[str, ...], change: Change) -> Array:
    """Returns the standard deviation (N,) of each number in `names`, with poses, points and all these numbers free.

    The scene and the change must be those that `adjust` has fitted. Errors of one track may be alike: each track counts
    as one measurement (a sandwich of the normal equations and the tracks' own gradients).
    """
    values = np.array([change.value(name) for name in names])
    equations = _Equations(scene, rig, seen, names, values, predicted(scene, rig, change, seen))
    return equations.sigmas(tuple(range(len(names))))


def _adjusted(
    scene: Scene,
    rig: Rig,
    seen: Observations,
    names: tuple[str, ...],
    values: Array,
    iterations: int,
    loss_px: float,
) -> tuple[Scene, Array, float]:
    damping = 1e-3
    now = predicted(scene, rig, change_of(names, values), seen)
    cost = float(costs(now.residuals, loss_px).sum())
    for _ in range(iterations):
        equations = _Equations(scene, rig, seen, names, values, now, loss_px)
        for _ in range(5):
            twists, points, shared = equations.solve(damping)
            tried = scene.moved(twists, points), values + shared
            after = predicted(tried[0], rig, change_of(names, tried[1]), seen)
            tried_cost = float(costs(after.residuals, loss_px).sum())
            if tried_cost < cost:
                break
            damping *= 8
        else:
            break
        small = cost - tried_cost < ENOUGH * cost
        (scene, values), now, cost, damping = tried, after, tried_cost, max(damping / 8, 1e-6)
        if small:
            break
    return scene, values, cost


@dataclass(frozen=True)
class Promise:
    """What a linearisation says of a set of numbers that would be free."""

    gain: float
    """Share of the cost that one step with them free is expected to save."""
    sigmas: tuple[float, ...]
    """Standard deviation of each number, in its own unit, with the numbers of its group free, too."""


def screened(
    scene: Scene, rig: Rig, seen: Observations, subsets: Mapping[tuple[str, ...], tuple[str, ...]]
) -> dict[tuple[str, ...], Promise]:
    """Returns what each set of numbers promises; its group, by which it is known, contains it.

    The scene must be one that `adjust` has fitted. One linearisation serves all.
    """
    names = tuple(dict.fromkeys(name for group in subsets.values() for name in group))
    values = np.zeros(len(names))
    now = predicted(scene, rig, change_of(names, values), seen)
    equations = _Equations(scene, rig, seen, names, values, now)
    cost = float(costs(now.residuals).sum())
    alone = equations.saved(())
    known: dict[tuple[str, ...], Array] = {}
    promises = {}
    for subset, group in subsets.items():
        saved = equations.saved(tuple(names.index(name) for name in subset))
        if group not in known:
            known[group] = equations.sigmas(tuple(names.index(name) for name in group))
        sigmas = tuple(float(known[group][group.index(name)]) for name in subset)
        promises[subset] = Promise((saved - alone) / max(cost, 1e-12), sigmas)
    return promises


class _Equations:
    """Normal equations of one iteration, with the points to be eliminated."""

    def __init__(
        self,
        scene: Scene,
        rig: Rig,
        seen: Observations,
        names: tuple[str, ...],
        values: Array,
        now: Predicted,
        loss_px: float = LOSS_PX,
    ) -> None:
        self.poses, self.points, self.shared = len(scene.times_s), len(scene.points), len(names)
        good = np.asarray(np.isfinite(now.residuals).all(axis=1))
        residuals = np.where(good[:, None], now.residuals, 0.0)
        weights = np.where(good, 1 / (loss_px**2 + (residuals**2).sum(axis=1)), 0.0)
        self.curvature = loss_px**2 * float((weights**2).sum() / max(weights.sum(), 1e-12))
        root = np.sqrt(weights)[:, None]
        by_twist = np.where(good[:, None, None], now.by_twist, 0.0) * root[..., None]
        by_point = np.where(good[:, None, None], now.by_point, 0.0) * root[..., None]
        self.residuals, self.point = (residuals * root).ravel(), seen.point
        rows = np.arange(2 * len(seen)).reshape(-1, 2, 1)
        before = (1 - now.weight)[:, None, None] * by_twist
        after = now.weight[:, None, None] * by_twist
        columns = [6 * (now.knot + k)[:, None, None] + np.arange(6) for k in (0, 1)]
        self.jacobian = self._sparse(
            [
                (rows, columns[0], before),
                (rows, columns[1], after),
                *self._by_shared(scene, rig, seen, names, values, now, root),
            ],
            6 * self.poses + self.shared,
        )
        of_point = 3 * seen.point[:, None, None] + np.arange(3)
        self.by_points = self._sparse([(rows, of_point, by_point)], 3 * self.points)
        flat = by_point.reshape(-1, 2, 3)
        blocks = np.einsum("nki,nkj->nij", flat, flat)
        self.point_blocks = np.zeros((self.points, 3, 3))
        np.add.at(self.point_blocks, seen.point, blocks)
        self.matrix = (self.jacobian.T @ self.jacobian).toarray()
        self.cross = (self.jacobian.T @ self.by_points).toarray()
        self.gradient = self.jacobian.T @ self.residuals
        self.point_gradient = self.by_points.T @ self.residuals

    def _by_shared(self, scene, rig, seen, names, values, now, root):
        rows = np.arange(2 * len(seen)).reshape(-1, 2, 1)
        for k, name in enumerate(names):
            moved = values.copy()
            moved[k] += STEPS[name]
            there = predicted(scene, rig, change_of(names, moved), seen, derivatives=False)
            slope = np.nan_to_num(now.residuals - there.residuals) / STEPS[name] * root
            yield rows, np.full_like(rows, 6 * self.poses + k), slope[..., None]

    @staticmethod
    def _sparse(parts, width: int):
        rows, columns, values = (
            np.concatenate([np.broadcast_to(part[i], part[2].shape).ravel() for part in parts]) for i in range(3)
        )
        return sparse.csr_array((values, (rows.astype(int), columns.astype(int))), shape=(int(parts[0][0].size), width))

    def solve(self, damping: float) -> tuple[Array, Array, Array]:
        """Returns the changes of poses (K, 6), points (P, 3) and shared values."""
        blocks = (
            self.point_blocks + np.eye(3) * (damping * np.einsum("pii->p", self.point_blocks) / 3 + 1e-9)[:, None, None]
        )
        inverse = np.linalg.inv(blocks)
        width = len(self.matrix)
        cross = self.cross.reshape(width, self.points, 3)
        eliminated = np.einsum("cpi,pij->cpj", cross, inverse).reshape(width, -1)
        system = self.matrix - eliminated @ self.cross.T
        gradient = self.gradient - eliminated @ self.point_gradient
        system[np.diag_indices(width)] += damping * np.diag(self.matrix) + 1e-9
        free = np.r_[6:width]  # the first pose is the origin
        step = np.zeros(width)
        step[free] = np.linalg.lstsq(system[np.ix_(free, free)], gradient[free], rcond=1e-14)[0]
        rest = self.point_gradient - self.cross.T @ step
        points = np.einsum("pij,pj->pi", inverse, rest.reshape(-1, 3))
        return step[: 6 * self.poses].reshape(-1, 6), points, step[6 * self.poses :]

    def saved(self, shared: tuple[int, ...]) -> float:
        """Returns how much one step with these shared values free lowers the cost, by the linearisation."""
        free, system = self._free(shared)
        gradient = self._reduced[1][free]
        return float(gradient @ np.linalg.solve(system, gradient))

    def sigmas(self, shared: tuple[int, ...]) -> Array:
        """Returns the standard deviations of these shared values, all of them free, with each track as one
        measurement."""
        free, system = self._free(shared)
        last = np.eye(len(free))[:, len(free) - len(shared) :]
        moved = self._by_track[:, free] @ np.linalg.solve(system, last) / max(self.curvature, 1e-3)
        count = np.count_nonzero(np.einsum("pii->p", self.point_blocks))
        return np.sqrt((moved**2).sum(axis=0) * count / max(count - 1, 1))

    def _free(self, shared: tuple[int, ...]) -> tuple[NDArray[np.int64], Array]:
        free = np.r_[6 : 6 * self.poses, [6 * self.poses + k for k in shared]].astype(int)
        return free, self._reduced[0][np.ix_(free, free)] + np.diag(1e-6 * np.diag(self.matrix)[free] + 1e-9)

    @cached_property
    def _eliminated(self) -> Array:
        """(C, P, 3)"""
        blocks = self.point_blocks + np.eye(3) * (1e-6 * np.einsum("pii->p", self.point_blocks) + 1e-9)[:, None, None]
        cross = self.cross.reshape(len(self.matrix), self.points, 3)
        return np.einsum("cpi,pij->cpj", cross, np.linalg.inv(blocks))

    @cached_property
    def _reduced(self) -> tuple[Array, Array]:
        """The matrix and the gradient without the points."""
        eliminated = self._eliminated.reshape(len(self.matrix), -1)
        return self.matrix - eliminated @ self.cross.T, self.gradient - eliminated @ self.point_gradient

    @cached_property
    def _by_track(self) -> Array:
        """(P, C) the gradient without the points that each track gives."""
        rows = np.arange(len(self.residuals))
        of_track = self._sparse([(rows, np.repeat(self.point, 2), self.residuals)], self.points)
        own = self.point_gradient.reshape(-1, 3)
        return (self.jacobian.T @ of_track).toarray().T - np.einsum("cpi,pi->pc", self._eliminated, own)


def placed(scene: Scene, rig: Rig, change: Change, seen: Observations) -> tuple[Scene, Array]:
    """Returns the scene with its points moved to where they fit best while the poses stay, and the mean cost (P,) of
    each, NaN where it has no observation.

    This is how held-out points judge poses and calibration, which they had no part in. Each point starts from where it
    is and, with wide losses first, from there again; the better place counts.
    """
    count = len(scene.points)
    observed = np.bincount(seen.point, minlength=count)
    near, cost = _placed(scene, rig, change, seen, LOSS_PX)
    wide = scene
    for loss_px in WIDE_PX:
        wide, _ = _placed(wide, rig, change, seen, loss_px)
    wide, wide_cost = _placed(wide, rig, change, seen, LOSS_PX)
    better = wide_cost < cost
    scene = replace(scene, points=np.where(better[:, None], wide.points, near.points))
    return scene, np.where(observed > 0, np.minimum(cost, wide_cost) / np.maximum(observed, 1), np.nan)


def _placed(scene: Scene, rig: Rig, change: Change, seen: Observations, loss_px: float) -> tuple[Scene, Array]:
    """Returns the scene with its points moved, and the cost (P,) of each."""
    count, damping = len(scene.points), np.full(len(scene.points), 1e-3)

    def total(residuals: Array) -> Array:
        return np.asarray(np.bincount(seen.point, costs(residuals, loss_px), minlength=count), float)

    now = predicted(scene, rig, change, seen)
    points, every_residual, every_slope, cost = scene.points, now.residuals, now.by_point, total(now.residuals)
    for _ in range(POINT_ITERATIONS):
        good = np.asarray(np.isfinite(every_residual).all(axis=1))
        residuals = np.where(good[:, None], every_residual, 0.0)
        by_point = np.where(good[:, None, None], every_slope, 0.0)
        weights = good / (loss_px**2 + (residuals**2).sum(axis=1))
        blocks, gradients = np.zeros((count, 3, 3)), np.zeros((count, 3))
        np.add.at(blocks, seen.point, weights[:, None, None] * np.einsum("nki,nkj->nij", by_point, by_point))
        np.add.at(gradients, seen.point, weights[:, None] * np.einsum("nki,nk->ni", by_point, residuals))
        trace = np.einsum("pii->p", blocks)
        damped = blocks + np.eye(3) * (damping * trace + 1e-9)[:, None, None]
        tried = points + np.linalg.solve(damped, gradients[..., None])[..., 0]
        after = predicted(replace(scene, points=tried), rig, change, seen)
        tried_cost = total(after.residuals)
        better = tried_cost < cost
        damping = np.where(better, damping / 8, damping * 8)
        mine = better[seen.point]
        points, cost = np.where(better[:, None], tried, points), np.where(better, tried_cost, cost)
        every_residual = np.where(mine[:, None], after.residuals, every_residual)
        every_slope = np.where(mine[:, None, None], after.by_point, every_slope)
    return replace(scene, points=points), cost
