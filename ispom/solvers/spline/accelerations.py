"""Estimates the rig's accelerations from the recording: the smoothness prior of the spline where images are missing.

The size of a prior is found by its evidence (MacKay 1992, "Bayesian interpolation", section 4.4): the sum of squares of
the estimates, divided by the number of components that the observations determine.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.solvers.spline.continuous import Solution, solve
from ispom.solvers.spline.curve import add_smoothness
from ispom.solvers.spline.problem import SplineProblem

ITERATIONS = 2
"""Number of times that accelerations and spline are estimated in turn. Images determine most of the accelerations, and
a third round changes them by less than a percent."""
LEAST_DETERMINED = 6.0
"""Least number of determined components of accelerations from which the prior is estimated."""
MIN_SIGMA = 0.1
"""Least standard deviation [rad/s^2, m/s^2]: zero would fix the motion. A rig at rest accelerates less."""


def solve_with_accelerations(problem: SplineProblem, iterations: int) -> Solution:
    """Runs `continuous.solve` with `smoothness` estimated from the data, for knots dense enough for any motion.

    If the frames of one camera are before and after all those of the other, only the spline relates the two. Motion
    that too few knots cannot follow would rotate them by ten times its own size.
    """
    begun = found = solve(problem, iterations)
    for _ in range(ITERATIONS):
        better = solve(replace(found.problem, smoothness=accelerations(found)), iterations)
        found = replace(better, iterations=found.iterations + better.iterations)
    return replace(found, errors_before=begun.errors_before, cost_before=begun.cost_before)


def accelerations(solution: Solution) -> tuple[float, float]:
    """Estimates the standard deviations of each component of angular [rad/s^2] and linear [m/s^2] acceleration."""
    problem, spline = solution.problem, solution.problem.spline
    covariance = solution.parameter_covariance(problem.prior)
    components = 3 * (len(spline) - 2)

    def size(angular: bool) -> float:
        sigma = problem.smoothness[0 if angular else 1]
        sigmas = (sigma, np.inf) if angular else (np.inf, sigma)
        information = np.zeros_like(covariance)
        squares = 2 * add_smoothness(
            spline.rotations, spline.positions, spline.spacing_s, *sigmas, information, np.zeros(len(covariance))
        )
        determined = components - float(np.sum(information * covariance))
        if determined < LEAST_DETERMINED:
            return sigma
        return max(sigma * float(np.sqrt(squares / determined)), MIN_SIGMA)

    return size(True), size(False)
