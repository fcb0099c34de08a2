"""The branches of the source, and their comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ...engine.error_curve import ErrorCurve
from ...engine.events import Opened
from ..state import Computed, Event, FeatureState, Opening, Resumed, State
from .branches import FIRST, Branch
from .comparison import Comparison


@dataclass(frozen=True, eq=False)
class Branches(FeatureState):
    all: tuple[Branch, ...] = ()
    """All branches of the source; the first is its first run."""
    shown: int = 0
    """The number of the one that is shown."""
    comparison: Comparison | None = None
    """The comparison of two branches; None without one."""

    @property
    def curves(self) -> Mapping[str, ErrorCurve]:
        """By method, the position errors of the branch that is shown; empty without ground truth."""
        return next((b.measured.curves for b in self.all if b.number == self.shown), {})

    def reduce(self, event: Event) -> Branches:
        match event:
            case Opening():
                return Branches()
            case Opened() if not self.all:
                return replace(self, all=(Branch(0, FIRST),))
            case Resumed():
                return replace(self, shown=event.branch)
            case Computed(record, tally, history_usage):
                known = {"computed": record.index + 1, "tally": tally, "history_usage": history_usage}
                return replace(self, all=tuple(replace(b, **known) if b.number == self.shown else b for b in self.all))  # type: ignore[arg-type]
            case _:
                return self

    def with_branch(self, number: int, **values: Any) -> Branches:
        """Returns the branches with new values of one of them."""
        return replace(self, all=tuple(replace(b, **values) if b.number == number else b for b in self.all))

    def covered(self) -> Branches:
        return replace(self, all=self.all[:1], comparison=None)

    def address(self) -> dict[str, int]:
        return {"branch": self.shown}

    def page(self, state: State) -> dict[str, Any]:
        now = self.comparison
        return {
            "branches": [branch.number for branch in self.all],
            "branch": self.shown,
            "compared": now and [now.shown, now.other, now.done, now.finished],
        }
