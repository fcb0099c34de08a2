"""Differences: where two branches differ first, in what, by how much, and the next ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

import viser

from ...session import commands as do
from ...session.state import State
from ...views.viser.markup import renderer
from ..diff.text import lines
from .comparison import MOST, Comparison
from .state import Branches

if TYPE_CHECKING:
    from ...session.session import Session

render = renderer(__package__)

FIRST, PREVIOUS, NEXT = "First", "◀ Difference", "Difference ▶"


class DifferencesPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._state = session, session.state
        hint = "Go to the frames listed below, in the branch that is shown."
        self._buttons = gui.add_button_group("", (FIRST, PREVIOUS, NEXT), hint=hint, visible=False)
        self._buttons.on_click(self._clicked)
        self._text = gui.add_html("", visible=False)

    def _clicked(self, _: object) -> None:
        found, at = _exposures(self._state[Branches].comparison), self._state.index
        before, after = [i for i in found if i < at], [i for i in found if i > at]
        wanted = {FIRST: found[:1], PREVIOUS: before[-1:], NEXT: after[:1]}[self._buttons.value]
        for index in wanted:
            self._session.post(do.Seek(index))

    def show(self, state: State) -> None:
        before, self._state = self._state, state
        branches = state[Branches]
        if branches is before[Branches] and self._text.content:
            return
        comparison = branches.comparison
        self._buttons.visible = bool(_exposures(comparison))
        self._text.visible = comparison is not None
        text = _text(comparison, state) if comparison is not None else ""
        if text != self._text.content:
            self._text.content = text


def _exposures(comparison: Comparison | None) -> list[int]:
    found = comparison.first if comparison is not None else ()
    return [d.exposure for d in found if d.exposure is not None]


def _text(comparison: Comparison, state: State) -> str:
    """How far it is compared, and what was found, as HTML."""
    names = {branch.number: branch.name for branch in state[Branches].all}
    return render(
        "differences.html",
        comparison=comparison,
        a=names.get(comparison.shown, "a deleted branch"),
        b=names.get(comparison.other, "a deleted branch"),
        blocks=[list(lines(divergence)) for divergence in comparison.first],
        most=MOST,
    )
