"""Windowed bundle adjustment over one camera or a rectified pair, with priors and other residual families.

Uses the Schur complement over the points (Triggs et al. 2000), the robust loss and Levenberg's damping; marginalisation
is as in Leutenegger et al. 2015, section 3.5. It can also estimate corrections of the camera's or pair's calibration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.numerics.cholesky import factor, solve_factored
from ispom.numerics.levenberg_marquardt import minimise
from ispom.numerics.twist import moved
from ispom.solvers.window.kernels import FIXED_WEIGHTS, Eliminated, Reduced, padded, point_steps, reduce_points
from ispom.solvers.window.observation import robust_cost
from ispom.solvers.window.prior import POSE, Prior, Sandwich
from ispom.solvers.window.problem import Window

FIXED_INFORMATION = 1e30
"""Information of a correction that is fixed: a standard deviation of 1e-15, below the rounding of all other numbers. So
it takes no step, while covariances and priors keep its rows and columns: all of them have the same unknowns."""
MAX_DEPTH_GROWTH = 10.0
"""Largest factor by which one step may increase the depth of a point."""


@dataclass(frozen=True, eq=False)
class Adjusted:
    """The result of `adjust`."""

    window: Window
    cost_before: float
    cost_after: float
    distances: Array
    """(K,) reprojection errors at the end (both images), normalised; 1e9 behind the camera."""
    iterations: int


def adjust(window: Window, scale: float, iterations: int = 10, tolerance: float = 1e-3) -> Adjusted:
    """Minimises the robust loss of scale `scale` (normalised units) over free poses, points and corrections.

    Ends early when a step lowers the cost by less than the share `tolerance`. Deterministic.
    """
    found = minimise(
        window,
        lambda values: total_cost(values, scale),
        lambda values, damping: _moved(values, *_step(values, scale, damping)),
        iterations,
        tolerance,
    )
    distances = np.minimum(np.sqrt(found.values.squared_errors), 1e9)
    return Adjusted(found.values, found.cost_before, found.cost, distances, found.iterations)


def total_cost(window: Window, scale: float) -> float:
    """Returns half the robust sum of squares, in units of the squared loss scale `scale`, plus the terms' cost."""
    return float(robust_cost(window.squared_errors, scale)) + sum(term.cost(window) for term in window.terms)


def covariance(window: Window, scale: float) -> Array:
    """Returns the covariance (6 C + E, 6 C + E) of all poses (left twists) and corrections."""
    return np.linalg.inv(Equations.of(window, scale).symmetric)


def marginalise(
    window: Window, points: NDArray[np.bool_], scale: float, sandwich: Callable[[Window], Sandwich] | None = None
) -> Prior:
    """Marginalises pose 0, the residuals of families that depend on it, and the points of the mask (M,) with all their
    observations.

    Returns the prior on the other poses and the corrections. `sandwich`, if given, computes the sandwich of a window
    over poses and corrections, which the prior then keeps.
    """
    gone = points[window.owners]
    number = np.cumsum(points) - 1
    part = replace(
        window,
        points=window.points[points],
        cameras=window.cameras[gone],
        owners=number[window.owners[gone]],
        seen=window.seen[gone],
        factors=window.factors[gone] if window.baseline else window.factors,
        families=tuple(family.of_first_pose(window) for family in window.families),
    )
    equations = Equations.of(part, scale)
    h, g, a = equations.symmetric, -equations.right, slice(0, POSE)
    b = slice(POSE, len(g))
    inverse = np.linalg.pinv(h[a, a], rcond=1e-12, hermitian=True)
    gain = h[b, a] @ inverse
    rest = h[b, b] - gain @ h[a, b]
    return Prior(
        window.rotations[1:],
        window.translations[1:],
        window.extra,
        (rest + rest.T) / 2,
        g[b] - gain @ g[a],
        sandwich=None if sandwich is None else sandwich(part).without(gain, np.arange(len(g)) < POSE),
    )


@dataclass(frozen=True, eq=False)
class Equations:
    """Normal equations of poses and corrections (Schur complement), and the data for the points' steps."""

    matrix: Array
    """(6 C + E, 6 C + E) matrix, its lower triangle."""
    right: Array
    """(6 C + E,) right side."""
    eliminated: Eliminated

    @staticmethod
    def of(window: Window, scale: float, damping: float = 0.0, second_order: float = FIXED_WEIGHTS) -> Equations:
        """Builds the equations. `damping` raises the points' diagonal entries by this share, not those of `matrix`.

        `second_order` selects the second derivatives of the loss, see kernels.reduce_points.
        """
        views, points, seen = len(window.rotations), len(window.points), len(window.cameras)
        poses, extra = POSE * views, len(window.extra)
        shown = window.shown
        wide = padded(shown)
        blocks, side = np.zeros((views, views, POSE, POSE)), np.zeros((views, POSE, wide))
        eliminated = Eliminated(
            np.empty((points, 6)), np.empty((points, 3)), np.empty((seen, 12)), np.zeros((points, 3, wide))
        )
        reduced = Reduced(blocks, side, np.zeros((shown, wide)), np.zeros((views, POSE)), np.zeros(shown))
        reduce_points(scale, damping, second_order, reduced, eliminated, window.observed)
        matrix, right, last = np.zeros((poses + extra, poses + extra)), np.zeros(poses + extra), poses + shown
        matrix[:poses, :poses] = blocks.transpose(0, 2, 1, 3).reshape(poses, poses)
        matrix[poses:last, :poses] = side[:, :, :shown].reshape(poses, shown).T
        matrix[poses:last, poses:last] = reduced.corner[:, :shown]
        right[:poses], right[poses:last] = -reduced.by_poses.ravel(), -reduced.by_corrections
        for term in window.terms:
            term.add(window, matrix, right)
        matrix[poses:, poses:] += np.diag(np.where(window.extra_sigma > 0, 0.0, FIXED_INFORMATION))
        return Equations(matrix, right, eliminated)

    @property
    def symmetric(self) -> Array:
        """Returns the matrix (6 C + E, 6 C + E) with both triangles."""
        return np.tril(self.matrix) + np.tril(self.matrix, -1).T


def _step(window: Window, scale: float, damping: float) -> tuple[Array, Array, Array]:
    """Returns one damped step of the poses (C, 6), the points (M, 3) and the corrections (E,)."""
    equations, f = Equations.of(window, scale, damping), POSE * window.fixed
    free = np.ascontiguousarray(equations.matrix[f:, f:])
    free.flat[:: len(free) + 1] = free.diagonal() * (1 + damping) + 1e-12
    solution = np.zeros(len(equations.right))
    solution[f:] = solve_factored(factor(free), equations.right[f:])
    poses, extra = np.split(solution, [POSE * len(window.rotations)])
    poses = poses.reshape(-1, POSE)
    shown = extra[: window.shown]
    return poses, point_steps(window.cameras, window.owners, equations.eliminated, poses, shown), extra


def _moved(window: Window, pose_step: Array, point_step: Array, extra_step: Array) -> Window:
    rotations, translations = moved(window.rotations, window.translations, pose_step)
    return replace(
        window,
        rotations=rotations,
        translations=translations,
        points=window.points + as_inverse_depths(window, point_step),
        extra=window.extra + extra_step,
    )


def as_inverse_depths(window: Window, step: Array) -> Array:
    """Returns steps (M, 3) that change the points' inverse depths as `step` (M, 3) does to first order.

    Inverse depths are those in the first camera of each point. Observations are nearly linear in them, but not in the
    depths of far points: with depths, a disparity offset of half a pixel takes fifty steps, most of them rejected.
    """
    first = window.cameras[np.searchsorted(window.owners, np.arange(len(step)))]
    axis = window.rotations[first, 2]
    depth = np.einsum("mi,mi->m", axis, window.points) + window.translations[first, 2]
    farther = np.einsum("mi,mi->m", axis, step) / np.where(np.abs(depth) > 1e-9, depth, 1e-9)
    return step / np.maximum(1 - farther, farther / (MAX_DEPTH_GROWTH - 1))[:, None]
