"""Decisions that all optimisers of this package report about an optimisation: cost, iterations, and window."""

from __future__ import annotations

from ispom.types import Check, Decision

ADJUSTED = "Did the optimisation converge?"

COST = Check(
    "cost",
    "cost after the optimisation, against before",
    "warning",
    ADJUSTED,
    "<=",
    passes="The cost fell from {threshold} to {value}.",
    fails="Optimisation doubtful: the cost rose from {threshold} to {value}.",
)
ITERATIONS = Check(
    "iterations",
    "iterations of the optimisation",
    "finding",
    ADJUSTED,
    "<=",
    passes="The optimisation took {value} iterations (maximum {threshold}).",
    fails="The optimisation took {value} iterations, more than {threshold}: it began with a wider loss.",
)
BUNDLE_COST = Check(
    "bundle_cost",
    "bundle cost, after / before",
    "warning",
    ADJUSTED,
    "<",
    passes="Bundle adjustment reduced the cost to {value:.1%}.",
    fails="Optimisation doubtful: bundle adjustment did not reduce the cost ({value:.1%} of it is left).",
)
WINDOW = Check(
    "window",
    "keyframes in the window",
    "finding",
    ADJUSTED,
    "<=",
    passes="The window holds {value} keyframes (maximum {threshold}).",
    fails="The window is full: one of its {value} keyframes left it ({threshold} are kept).",
)


def optimised(before: float, after: float, iterations: int, most_iterations: int) -> tuple[Decision, ...]:
    """Returns decisions about the cost (half the robust sum of squares) before and after, and about the iterations."""
    return COST.of(after, before), ITERATIONS.of(iterations, most_iterations)
