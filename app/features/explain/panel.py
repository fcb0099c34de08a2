"""Why: a card for each method at the exposure shown. Each check in it is a button: its quantity over time."""

from __future__ import annotations

import viser

from ispom.methods import Config

from ...session.branching.branches import changes
from ...session.state import State
from ..markup import render
from .card import cards


class WhyPanel:
    def __init__(self, gui: viser.GuiApi) -> None:
        self._html = gui.add_html("")
        self._shown: tuple[object, ...] = ()
        """What the text was made from."""

    def show(self, state: State) -> None:
        shown = (state.displayed, state.plotted, state.methods, state.config, _coming(state))
        if shown != self._shown:
            self._shown = shown
            self._html.content = report(state)


def report(state: State) -> str:
    """The exposure's story as HTML; without one, whether the first is being computed or waits to be asked for."""
    record = state.displayed
    return render(
        "why.html",
        record=record,
        methods=len(state.methods),
        cards=cards(record) if record is not None else (),
        settings=changes((state.methods, Config()), (state.methods, state.config)),
        plotted=state.plotted,
        coming=_coming(state),
    )


def _coming(state: State) -> bool:
    return state.displayed is None and (state.playing or state.activity is not None)
