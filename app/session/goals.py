"""What a run goes on towards: a frame at which something holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..engine.conditions.evaluate import matches, shown, values
from ..engine.conditions.parser import Expression

if TYPE_CHECKING:
    from .current_run import CurrentRun


class Goal:
    """Looked for at each new frame. Both texts are for the person; empty for none."""

    def reached(self, run: CurrentRun) -> str | None:
        """What holds at the newest frame; None if it does not hold there."""
        raise NotImplementedError

    def missed(self, run: CurrentRun) -> str:
        """That the run has ended, and it held nowhere."""
        raise NotImplementedError


@dataclass(frozen=True)
class Holds(Goal):
    """A condition over the quantities of the run."""

    condition: Expression

    def reached(self, run: CurrentRun) -> str | None:
        last = len(run.series) - 1
        return measured(self.condition, run, last) if matches(self.condition, run.series, last) else None

    def missed(self, run: CurrentRun) -> str:
        return f"{self.condition.text} held at no frame up to the end"


def measured(condition: Expression, run: CurrentRun, index: int) -> str:
    """What was measured at a frame where the condition held."""
    found = values(condition, run.series.row(index, condition.quantities))
    numbers = ", ".join(f"{q.name} {shown(found[q.name], q.unit)}" for q in condition.quantities)
    return f"stopped at frame {index}: {numbers}"
