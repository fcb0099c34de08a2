"""Goals of a run: it is computed up to a frame at which a condition holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..engine.conditions.evaluate import matches, shown, values
from ..engine.conditions.parser import Expression

if TYPE_CHECKING:
    from .current_run import CurrentRun


class Goal:
    """A goal that is tested at each new frame. Both methods return texts for the person, which may be empty."""

    def reached(self, run: CurrentRun) -> str | None:
        """Returns a text about the newest frame if the goal is reached there, else None."""
        raise NotImplementedError

    def missed(self, run: CurrentRun) -> str:
        """Returns a text that the run has ended without the goal."""
        raise NotImplementedError


@dataclass(frozen=True)
class Holds(Goal):
    """The goal that a condition over the quantities of the run holds."""

    condition: Expression

    def reached(self, run: CurrentRun) -> str | None:
        last = len(run.series) - 1
        return measured(self.condition, run, last) if matches(self.condition, run.series, last) else None

    def missed(self, run: CurrentRun) -> str:
        return f"{self.condition.text} held at no frame up to the end"


def measured(condition: Expression, run: CurrentRun, index: int) -> str:
    """Returns the measured values of the condition at a frame where it held."""
    found = values(condition, run.series.row(index, condition.quantities))
    numbers = ", ".join(f"{q.name} {shown(found[q.name], q.unit)}" for q in condition.quantities)
    return f"stopped at frame {index}: {numbers}"
