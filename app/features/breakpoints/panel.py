"""Break: a condition to run on until, its value at the frame shown, and where it holds in what is computed."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import viser

from ispom.errors import InputError

from ...engine.conditions.evaluate import matches, shown
from ...engine.conditions.parser import Expression, parse
from ...engine.history.quantity import Quantity
from ...engine.history.series import Series
from ...session.state import State
from ...views.viser.panels import Panel, renderer
from .commands import FindMatch, RunUntil

if TYPE_CHECKING:
    from ...session.session import Session

render = renderer(__package__)

PREVIOUS, UNTIL, NEXT = "◀ Match", "Run until", "Match ▶"
HINT = (
    "Run until: runs on, as fast as possible, to the next frame where the condition holds. Match: the previous or "
    "next one of those that are computed."
)
MOST_NAMES = 12
"""Most names that are listed of those that fit what is being written."""
EXAMPLE = 'stereo.status == "lost" or monocular.inliers < 30'


class BreakPointPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._state = session, session.state
        self._condition = gui.add_text("condition", "", hint="Stops the run where it holds.")
        self._condition.on_update(lambda _: self._refresh())
        self._buttons = gui.add_button_group("", (PREVIOUS, UNTIL, NEXT), hint=HINT)
        self._buttons.on_click(self._clicked)
        self._hits = _Hits()
        self._text = gui.add_html("")
        self._refresh()

    def _clicked(self, _: object) -> None:
        condition, button = self._condition.value, self._buttons.value
        self._session.post(RunUntil(condition) if button == UNTIL else FindMatch(condition, button == NEXT))

    def show(self, state: State) -> None:
        self._state = state
        self._refresh()

    def _refresh(self) -> None:
        text = _text(self._condition.value, self._state, self._session.series, self._hits)
        if text != self._text.content:
            self._text.content = text


class _Hits:
    """How often a condition holds, counted on as the run goes on."""

    def __init__(self) -> None:
        self._of: tuple[str, Series] | None = None
        self._counted = self._hits = 0

    def count(self, expression: Expression, series: Series, computed: int) -> int:
        """At how many of the computed frames it holds."""
        if self._of is None or self._of[0] != expression.text or self._of[1] is not series:
            self._of, self._counted, self._hits = (expression.text, series), 0, 0
        for index in range(self._counted, computed):
            self._hits += matches(expression, series, index)
        self._counted = max(self._counted, computed)
        return self._hits


def _text(condition: str, state: State, series: Series | None, hits: _Hits) -> str:
    """What the condition is worth now, and the names that could stand in it, as HTML."""
    known: dict[str, Any] = {"index": state.index, "computed": state.computed, "example": EXAMPLE}
    known |= {"mistake": "", "values": (), "names": (), "holds": False, "hits": 0}
    if series is None or not condition.strip():
        return render("break_point.html", **known)
    at = state.index if 0 <= state.index < len(series) else None
    known["names"] = [_entry(q, series, at) for q in _fitting(condition, series)]
    try:
        expression = parse(condition.strip(), series.quantities)
    except InputError as mistake:
        return render("break_point.html", **known | {"mistake": str(mistake)})
    known["values"] = [_entry(q, series, at) for q in expression.quantities]
    known["holds"] = at is not None and matches(expression, series, at)
    known["hits"] = hits.count(expression, series, min(state.computed, len(series)))
    return render("break_point.html", **known)


def _fitting(condition: str, series: Series) -> list[Quantity]:
    """Those whose names begin with, or else hold, what is written last; none where that is a whole name."""
    found = re.search(r"[A-Za-z_][\w.-]*$", condition)
    if found is None or found[0] in series.quantities:
        return []
    word = found[0]
    fitting = [q for name, q in series.quantities.items() if name.startswith(word)]
    fitting = fitting or [q for name, q in series.quantities.items() if word in name]
    return fitting[:MOST_NAMES]


def _entry(quantity: Quantity, series: Series, index: int | None) -> dict[str, str]:
    value = "" if index is None else shown(series.value(quantity, index), quantity.unit)
    return {"name": quantity.name, "help": quantity.help, "text": value}


PANELS = (Panel("Breakpoints", 500, BreakPointPanel),)
