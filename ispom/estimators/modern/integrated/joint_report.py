"""Decisions about an optimisation of the joint window: convergence, outliers, and the calibration."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.adjustment import optimised
from ispom.estimators.modern.integrated import checks
from ispom.estimators.modern.integrated.joint_window import JointWindow
from ispom.geometry import Array
from ispom.numerics.reductions import median
from ispom.solvers.spline.continuous import Solution
from ispom.solvers.spline.observation import RIG
from ispom.solvers.spline.problem import SplineProblem
from ispom.types import Decision, SplineFit

OUTLIER = 8.0
"""Residual, in standard deviations, beyond which an observation is an outlier: the loss flattens from 1 on."""


def report(window: JointWindow, solution: Solution, iterations: int) -> tuple[Decision, ...]:
    """Returns the decisions about an optimised window; `iterations` is the largest number allowed."""
    problem = solution.problem
    ratio = solution.cost_after / max(solution.cost_before, 1e-12)
    size = f"{len(problem.times_s)} frames, {len(problem.points)} points, {len(solution.errors)} observations"
    cost = checks.JOINT_COST.of(ratio, 1.0, f"{size}, {len(problem.spline)} knots, {solution.iterations} iterations")
    far = checks.OUTLIERS.of(int((solution.errors > OUTLIER).sum()), len(solution.errors))
    went = optimised(solution.cost_before, solution.cost_after, solution.iterations, iterations)
    return (cost, *went, far, *_rig_report(window))


def spline_fit(start_ns: int, problem: SplineProblem, solution: Solution) -> SplineFit:
    """Returns the spline before and after; `problem` is the solver's input, whose times count from `start_ns`."""
    found, observed, count = solution.problem, problem.exposures, len(problem.times_s)
    begun = problem.sampled()
    return SplineFit(
        start_ns + np.rint(problem.times_s * 1e9).astype(np.int64),
        problem.video,
        begun.positions[:count],
        solution.sampled.positions[:count],
        start_ns + np.rint(problem.spline.knot_times_s * 1e9).astype(np.int64),
        problem.spline.positions,
        found.spline.positions,
        _medians(solution.errors_before, observed, count),
        _medians(solution.errors, observed, count),
        solution.cost_before,
        solution.cost_after,
        solution.iterations,
    )


def _medians(errors: Array, exposure: NDArray[np.int64], count: int) -> Array:
    """Returns the median (E,) of the errors (O,) at each frame; NaN where there are none."""
    order = np.argsort(exposure, kind="stable")
    edges = np.searchsorted(exposure[order], np.arange(count + 1))
    at = [errors[order[a:b]] for a, b in pairwise(edges.tolist())]
    return np.array([median(found) if len(found) else np.nan for found in at])


def rig_covariance(window: JointWindow) -> Array:
    """Returns the covariance (7, 7) of the rig's corrections, 0 for fixed ones. Requires at least one estimate."""
    covariance, free = np.zeros((RIG, RIG)), np.flatnonzero(window.rig.free)
    inside = np.ix_(free, free)
    covariance[inside] = np.linalg.inv(window.rig_estimates[-1].information[inside])
    return covariance


def _rig_report(window: JointWindow) -> tuple[Decision, ...]:
    """Compares the corrections of the video camera's calibration with twice their standard deviations."""
    rig, change = window.rig, window.rig.minus(window.calibrated)
    covariance = rig_covariance(window)
    found = []
    parts = (
        (checks.VIDEO_TURNED, slice(0, 3), 180 / np.pi),
        (checks.VIDEO_SHIFTED, slice(3, 6), 1e3),
        (checks.CLOCK_OFFSET, slice(6, 7), 1e3),
    )
    for check, part, unit in parts:
        if rig.free[part].all():
            value, sigma = unit * change[part], unit * np.sqrt(np.diag(covariance)[part])
            size, limit = float(np.linalg.norm(value)), 2 * float(np.linalg.norm(sigma))
            each = ", ".join(f"{v:.3g} +- {s:.2g}" for v, s in zip(value, sigma, strict=True))
            found.append(check.of(float(value[0]) if len(value) == 1 else size, limit, each, size > limit))
    return tuple(found)
