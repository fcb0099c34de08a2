"""How much the rig accelerates, by the recording itself: what its spline is believed to do where no image says it.

Evidence of a prior's size (MacKay 1992, "Bayesian interpolation", section 4.4): the squares of what was found, over as
many of them as the observations determine.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.solvers.spline.continuous import Solution, solve
from ispom.solvers.spline.curve import add_smoothness
from ispom.solvers.spline.problem import SplineProblem

ROUNDS = 2
"""Of accelerations from a spline, and a spline from accelerations: images determine most of them, a third round changes
them by less than a percent."""
LEAST_DETERMINED = 6.0
"""Components of accelerations; of fewer a mean square says nothing."""
LEAST = 0.1
"""[rad/s^2, m/s^2] A rig that stands still accelerates less; zero would be held for certain."""


def solve_with_accelerations(problem: SplineProblem, iterations: int) -> Solution:
    """As `continuous.solve`, with `smoothness` by the data, for knots so dense that they follow any motion of the rig.

    Where one camera's exposures lie before and after all those of the other, the spline alone says how the two lie to
    each other: the little that too few knots cannot follow turns them by ten times as much.
    """
    begun = found = solve(problem, iterations)
    for _ in range(ROUNDS):
        better = solve(replace(found.problem, smoothness=accelerations(found)), iterations)
        found = replace(better, iterations=found.iterations + better.iterations)
    return replace(found, errors_before=begun.errors_before, cost_before=begun.cost_before)


def accelerations(solution: Solution) -> tuple[float, float]:
    """Standard deviations of angular [rad/s^2] and linear [m/s^2] acceleration, each component, between the knots."""
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
        return max(sigma * float(np.sqrt(squares / determined)), LEAST)

    return size(True), size(False)
