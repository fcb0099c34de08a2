"""Bundle adjustment of the doctor's scene with a few numbers of the calibration, and how it judges held-out points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.solvers import least_squares
from ispom.solvers.least_squares import Derivatives, Family, Problem, normal_equations
from ispom.types import Rig

from .hypothesis import STEPS, Change, change_of
from .scene import Observations, Predicted, Scene, predicted

AS_STATED = Change()
LOSS_PX = 0.5
"""Width of the robust loss: corners are tracked to about a third of it."""
WIDE_PX = (8.0, 2.0)
"""Widths of the loss before it, from that of the errors that a wrong calibration makes downwards."""
ITERATIONS = 8
POINT_ITERATIONS = 5
ENOUGH = 1e-3
"""Relative decrease of the cost at which an adjustment ends."""
FARTHEST = 100.0
"""Error [px] of a point that a camera cannot see."""
RIDGE = 1e-8
"""Damping of the normal equations of a fitted scene, whose scale may be free. With 1e-6 of a point's largest
information, its distance would be known too well, and so would a baseline."""
UNOBSERVED = 1e-9
"""Information of every unknown of a fitted scene: a pose without observations has no other."""


def costs(residuals: Array, loss_px: float = LOSS_PX) -> Array:
    """Returns the robust cost (N,) of residuals (N, 2)."""
    squares = np.nan_to_num((residuals**2).sum(axis=1), nan=FARTHEST**2)
    return np.log1p(np.minimum(squares, FARTHEST**2) / loss_px**2)


def adjust_gradually(
    scene: Scene, rig: Rig, seen: Observations, names: tuple[str, ...] = (), iterations: int = ITERATIONS
) -> tuple[Scene, Change, float]:
    """Does as `adjust`, but with wide losses first.

    A wrong calibration moves all observations of a camera by several pixels. With a narrow loss they are outliers, and
    the optimisation would ignore them.
    """
    change = AS_STATED
    for loss_px in WIDE_PX:
        scene, change, _ = adjust(scene, rig, seen, names, iterations, change, loss_px)
    return adjust(scene, rig, seen, names, iterations, change)


def adjust(
    scene: Scene,
    rig: Rig,
    seen: Observations,
    names: tuple[str, ...] = (),
    iterations: int = ITERATIONS,
    first: Change = AS_STATED,
    loss_px: float = LOSS_PX,
) -> tuple[Scene, Change, float]:
    """Returns the scene and the change of the calibration (in `names` only, from `first` on) that fit best, and their
    cost.

    Levenberg and Marquardt with a robust loss; the first pose is fixed, as are all known ones, and damping holds the
    scale where nothing else does.
    """
    start = Fit(scene, np.array([first.value(name) for name in names]))
    found = least_squares.adjust(problem_of(scene, rig, seen, names, loss_px), start, iterations, ENOUGH)
    return found.values.scene, change_of(names, found.values.numbers), found.cost


def uncertainties(scene: Scene, rig: Rig, seen: Observations, names: tuple[str, ...], change: Change) -> Array:
    """Returns the standard deviation (N,) of each number in `names`, with poses, points and all these numbers free.

    The scene and the change must be those that `adjust` has fitted. Errors of one track may be alike: each track counts
    as one measurement (a sandwich of the normal equations and the tracks' own gradients).
    """
    return _Fitted(scene, rig, seen, names, change).sigmas(names)


def covariance(scene: Scene, rig: Rig, seen: Observations, names: tuple[str, ...], change: Change) -> Array:
    """Returns the covariance (N, N) of the numbers in `names`, as `uncertainties` has their standard deviations."""
    return _Fitted(scene, rig, seen, names, change).covariance(names)


@dataclass(frozen=True)
class Promise:
    """The prediction of a linearisation for a set of free numbers."""

    gain: float
    """Share of the cost that one step with them free is expected to save."""
    sigmas: tuple[float, ...]
    """Standard deviation of each number, in its own unit, with the numbers of its group free, too."""


def screened(
    scene: Scene, rig: Rig, seen: Observations, subsets: Mapping[tuple[str, ...], tuple[str, ...]]
) -> dict[tuple[str, ...], Promise]:
    """Returns the promise of each set of numbers; its group, by which it is known, contains it.

    The scene must be one that `adjust` has fitted. One linearisation serves all.
    """
    fitted = _Fitted(scene, rig, seen, tuple(dict.fromkeys(n for group in subsets.values() for n in group)), AS_STATED)
    alone = fitted.saved(())
    known: dict[tuple[str, ...], Array] = {}
    promises = {}
    for subset, group in subsets.items():
        if group not in known:
            known[group] = fitted.sigmas(group)
        sigmas = tuple(float(known[group][group.index(name)]) for name in subset)
        promises[subset] = Promise((fitted.saved(subset) - alone) / max(fitted.cost, 1e-12), sigmas)
    return promises


@dataclass(frozen=True, eq=False)
class Fit:
    """The unknowns."""

    scene: Scene
    numbers: Array
    """(n,) of the calibration, in the order of their names."""


def problem_of(scene: Scene, rig: Rig, seen: Observations, names: tuple[str, ...], loss_px: float) -> Problem[Fit]:
    """All poses but the first, or none where they are known, all points, and these numbers of the calibration."""
    free = _free_of_poses(scene)

    def moved(now: Fit, shared: Array, blocks: Array) -> Fit:
        twists = np.zeros((len(scene.times_s), 6))
        twists[len(twists) - free // 6 :] = shared[:free].reshape(-1, 6)
        return Fit(now.scene.moved(twists, blocks), now.numbers + shared[free:])

    family = _ImagePoints(rig, seen, names, np.full(len(seen), loss_px))
    return Problem((family,), moved, free + len(names), len(scene.points), 3)


def _free_of_poses(scene: Scene) -> int:
    """Returns how many unknowns the poses have."""
    return 0 if scene.known else 6 * (len(scene.times_s) - 1)


@dataclass(frozen=True, eq=False)
class _ImagePoints(Family[Fit]):
    """Errors of points in the images [px]."""

    rig: Rig
    seen: Observations
    names: tuple[str, ...]
    widths: Array
    """(N,) all the same."""

    def loss(self, squares: Array) -> tuple[Array, Array]:
        """The robust loss, which grows no more beyond FARTHEST."""
        return np.log1p(np.minimum(squares, (FARTHEST / self.widths) ** 2)), 1 / (1 + squares)

    def residuals(self, values: Fit) -> Array:
        return -self._predicted(values.scene, values.numbers, False).residuals

    def derivatives(self, values: Fit) -> Derivatives:
        now = self._predicted(values.scene, values.numbers)
        by_twist, weight = np.nan_to_num(now.by_twist), now.weight[:, None, None]
        by_numbers = np.zeros((len(self.seen), 2, len(self.names)))
        for k, name in enumerate(self.names):
            step = STEPS[name] * (np.arange(len(self.names)) == k)
            there = self._predicted(values.scene, values.numbers + step, False)
            by_numbers[..., k] = np.nan_to_num(now.residuals - there.residuals) / STEPS[name]
        numbers = _free_of_poses(values.scene) + np.arange(len(self.names))
        columns, by_shared = [np.broadcast_to(numbers, (len(self.seen), len(numbers)))], [by_numbers]
        if not values.scene.known:
            poses = 6 * (now.knot[:, None, None] + [[-1], [0]]) + np.arange(6)  # the first pose is the origin
            columns = [np.maximum(poses, -1).reshape(-1, 12), *columns]
            by_shared = [(1 - weight) * by_twist, weight * by_twist, *by_shared]
        return Derivatives(
            np.concatenate(by_shared, axis=2),
            np.concatenate(columns, axis=1),
            np.nan_to_num(now.by_point),
            self.seen.point,
        )

    def _predicted(self, scene: Scene, numbers: Array, derivatives: bool = True) -> Predicted:
        return predicted(scene, self.rig, change_of(self.names, numbers), self.seen, derivatives)


class _Fitted:
    """The normal equations of a fitted scene, for any of the numbers."""

    def __init__(self, scene: Scene, rig: Rig, seen: Observations, names: tuple[str, ...], change: Change) -> None:
        self.names, problem = names, problem_of(scene, rig, seen, names, LOSS_PX)
        fit = Fit(scene, np.array([change.value(name) for name in names]))
        self.poses, self.cost = problem.shared - len(names), 2 * least_squares.cost(problem, fit)
        equations = normal_equations(problem, fit)
        reduced = equations.eliminated(RIDGE)
        self.matrix = reduced.matrix + UNOBSERVED * np.eye(problem.shared)
        self.gradient = reduced.gradient(equations.shared_gradient, equations.block_gradients)
        self.scores = reduced.scores(equations)
        self.tracks = np.count_nonzero(equations.blocks.any(axis=(1, 2)))
        squares = (problem.families[0].residuals(fit) ** 2).sum(axis=1) / LOSS_PX**2
        weights = 1 / (1 + squares[np.isfinite(squares)])
        # Across an error the loss curves by the weight, along it by w (2 w - 1): the mean of both is w^2.
        self.curvature = float((weights**2).sum() / max(weights.sum(), 1e-12))

    def saved(self, names: tuple[str, ...]) -> float:
        """Returns how much one step with these numbers free lowers the cost, by the linearisation."""
        free = self._free(names)
        return float(self.gradient[free] @ np.linalg.solve(self.matrix[np.ix_(free, free)], self.gradient[free]))

    def sigmas(self, names: tuple[str, ...]) -> Array:
        """Returns the standard deviations of these numbers, all of them free, with each track as one measurement."""
        return np.sqrt((self._influences(names) ** 2).sum(axis=0) * self.tracks / max(self.tracks - 1, 1))

    def covariance(self, names: tuple[str, ...]) -> Array:
        """Returns the covariance of these numbers, likewise."""
        influences = self._influences(names)
        return influences.T @ influences * (self.tracks / max(self.tracks - 1, 1))

    def _influences(self, names: tuple[str, ...]) -> Array:
        """Returns by how much each track moves each of these numbers."""
        free = self._free(names)
        last = np.eye(len(free))[:, self.poses :]
        influences = self.scores[:, free] @ np.linalg.solve(self.matrix[np.ix_(free, free)], last)
        return influences / max(self.curvature, 1e-3)

    def _free(self, names: tuple[str, ...]) -> NDArray[np.int64]:
        return np.r_[: self.poses, [self.poses + self.names.index(name) for name in names]].astype(int)


def placed(scene: Scene, rig: Rig, change: Change, seen: Observations) -> tuple[Scene, Array]:
    """Returns the scene with its points optimised for fixed poses, and the mean cost (P,) of each point; NaN for a
    point without observations.

    So held-out points judge poses and calibration that were fitted without them. Each point is optimised from its
    position, and again with wide losses first; the better result counts.
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
