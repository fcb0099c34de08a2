"""Levenberg-Marquardt: damping, trial, acceptance and stop, for any problem that can compute its damped step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from ispom.stop import check_stop

T = TypeVar("T")

FIRST_DAMPING, LOWEST_DAMPING = 1e-4, 1e-9
"""Default damping at the start, and its default least value."""
DAMPING_DIVISOR, DAMPING_FACTOR = 10, 30
"""Divisor of the damping after a step that lowered the cost, and its factor after one that did not."""


@dataclass(frozen=True, eq=False)
class Minimum(Generic[T]):
    """The result of `minimise`."""

    values: T
    cost_before: float
    cost: float
    iterations: int


def minimise(
    start: T,
    cost: Callable[[T], float],
    stepped: Callable[[T, float], T],
    iterations: int,
    tolerance: float,
    highest: float = 1e3,
    first: float = FIRST_DAMPING,
    lowest: float = LOWEST_DAMPING,
    settled: Callable[[], bool] = lambda: False,
) -> Minimum[T]:
    """Minimises `cost` from `start` in at most `iterations` steps; `stepped(values, damping)` computes one.

    A step that does not lower the cost is rejected. The damping starts at `first` and stays above `lowest`. Ends early
    when a step lowers the cost by less than the share `tolerance`, when `settled` is true after one that lowered it, or
    when the damping would exceed `highest`.
    Nocedal & Wright, Numerical Optimization, 10.3. Deterministic.
    """
    values, damping, done = start, first, 0
    before = now = cost(start)
    for done in range(1, iterations + 1):  # noqa: B007
        check_stop()
        trial = stepped(values, damping)
        trial_cost = cost(trial)
        if trial_cost < now:
            gain = (now - trial_cost) / max(now, 1e-300)  # a prior can make the cost negative
            values, now, damping = trial, trial_cost, max(damping / DAMPING_DIVISOR, lowest)
            if settled() or gain < tolerance:
                break
        else:
            damping *= DAMPING_FACTOR
            if damping > highest:
                break
    return Minimum(values, before, now, done)
