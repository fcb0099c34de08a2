"""What the optimisers of this package say of an adjustment: its cost, its iterations, and the window that it was of."""

from __future__ import annotations

from ispom.types import Check, Decision

ADJUSTED = "How did the adjustment go?"

COST = Check(
    "cost",
    "cost after the adjustment, against before",
    "warning",
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
BUNDLE_COST = Check(
    "bundle_cost",
    "bundle cost, after / before",
    "warning",
    ADJUSTED,
    "<",
    passes="Bundle adjustment left {value:.1%} of the cost.",
    fails="Bundle adjustment did not lower the cost: {value:.1%} of that before.",
)
WINDOW = Check(
    "window",
    "key frames in the window",
    "finding",
    ADJUSTED,
    "<=",
    passes="The window holds {value} of at most {threshold} key frames: nothing leaves it.",
    fails="The window had {value} key frames, of which it keeps {threshold}.",
)


def optimised(before: float, after: float, iterations: int, most_iterations: int) -> tuple[Decision, ...]:
    """Of half the robust sums of squares before and after, and of the iterations that it took."""
    return COST.of(after, before), ITERATIONS.of(iterations, most_iterations)
