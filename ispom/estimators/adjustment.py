"""What every optimiser of this package says of an adjustment: its cost and its iterations."""

from __future__ import annotations

from ispom.types import Check, Decision

ADJUSTED = "How did the adjustment go?"

COST = Check(
    "cost",
    "cost after the adjustment, against before",
    "finding",
    ADJUSTED,
    "<=",
    passes="The cost fell from {threshold} to {value}.",
    fails="The cost rose from {threshold} to {value}.",
)
ITERATIONS = Check(
    "iterations",
    "iterations of the adjustment",
    "finding",
    ADJUSTED,
    "<=",
    passes="It took {value} iterations of at most {threshold}.",
    fails="It took {value} iterations, more than {threshold}: at first with a wider loss.",
)


def optimised(before: float, after: float, iterations: int, most_iterations: int) -> tuple[Decision, ...]:
    """Of half the robust sums of squares before and after, and of the iterations that it took."""
    return COST.of(after, before), ITERATIONS.of(iterations, most_iterations)
