"""Where a condition holds, on the time axis."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from ...engine.conditions.evaluate import matches
from ...engine.conditions.parser import Expression
from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.web.time_axis import Marks
from .commands import Breakpoints

SLICE = 500
"""Frames at which a condition is evaluated for one message; each takes some 10 microseconds."""


class Matches(Marks):
    name: ClassVar[str] = "matches"
    sign: ClassVar[Literal["row"]] = "row"

    def __init__(self) -> None:
        super().__init__()
        self._marked: Expression | None = None
        self._matched = 0
        """Frames at which it was evaluated."""

    def since(self, state: State, run: CurrentRun) -> dict[str, Any] | None:
        series, marked = run.series, state[Breakpoints].marked
        if marked is not None and any(q.name not in series.quantities for q in marked.quantities):
            marked = None  # of a branch without that method
        news: dict[str, Any] | None = None
        if marked != self._marked:
            self._marked, self._matched = marked, 0
            label = marked.text if marked is not None else ""
            news = {"sign": self.sign, "label": label, "help": f"Frames at which {label} is true", "marks": []}
        if marked is not None and self._matched < len(series):
            among = range(self._matched, min(self._matched + SLICE, len(series)))
            self._matched = among.stop
            text = f"true here: {marked.text}"
            found = [{"at": i, "text": text} for i in among if matches(marked, series, i)]
            if news is None and (found or self._matched < len(series)):
                news = {"more": True, "marks": []}
            if news is not None:
                news["marks"] = found
        return news


MARKS = (Matches,)
