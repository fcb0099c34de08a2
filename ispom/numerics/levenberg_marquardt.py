"""Levenberg-Marquardt: damping, trial, acceptance and stop, for every problem that can solve for its damped step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from ispom.stop import check_stop

T = TypeVar("T")

FIRST, LOWEST = 1e-4, 1e-9
"""Damping at the start, and its least value, where nobody sets them."""
EASED, RAISED = 10, 30
"""The damping is divided by the one where a step lowered the cost, else multiplied by the other."""


@dataclass(frozen=True, eq=False)
class Minimum(Generic[T]):
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
    first: float = FIRST,
    lowest: float = LOWEST,
) -> Minimum[T]:
    """The values of least cost found from `start` in at most so many steps; `stepped(values, damping)` tries one.

    A step that does not lower the cost is forgotten. The damping begins with `first` and stays above `lowest`. Ends
    early when a step lowers the cost by less than the share `tolerance`, or the damping would be above `highest`.
    Nocedal & Wright, Numerical Optimization, 10.3. Deterministic.
    """
    values, damping, done = start, first, 0
    before = now = cost(start)
    for done in range(1, iterations + 1):  # noqa: B007
        check_stop()
        trial = stepped(values, damping)
        trial_cost = cost(trial)
        if trial_cost < now:
            gain = (now - trial_cost) / max(now, 1e-300)  # a prior makes it negative now and then
            values, now, damping = trial, trial_cost, max(damping / EASED, lowest)
            if gain < tolerance:
                break
        else:
            damping *= RAISED
            if damping > highest:
                break
    return Minimum(values, before, now, done)
