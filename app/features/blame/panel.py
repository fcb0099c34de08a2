"""What moved this pose: the answer, and a row for each part; a click shows its tracks in the image."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import viser

from ...engine.inspection.selection import Selection
from ...presentation import colours
from ...session.state import State
from ...views.viser.panels import Panel, renderer
from .commands import AskBlame
from .found import PoseBlame
from .state import Blames
from .words import answer, size, unit_of

if TYPE_CHECKING:
    from ...session.session import Session

render = renderer(__package__)

TAB, TITLE, ASK = "Explain", "What moved this pose", "Find what moved this pose"
HINT = "Leaves tracks, groups of them, keyframes, priors and sensors out of what each method solved at this frame."


class BlamePanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._shown: tuple[object, ...] = ()
        with gui.add_folder(TITLE, expand_by_default=False):
            self._ask = gui.add_button(ASK, icon=viser.Icon.ZOOM_QUESTION, hint=HINT, color="gray", disabled=True)
            self._ask.on_click(lambda _: session.post(AskBlame()))
            self._text = gui.add_html(report(()))

    def show(self, state: State) -> None:
        found = state[Blames].at(state)
        disabled = state.displayed is None
        if self._ask.disabled != disabled:
            self._ask.disabled = disabled
        if (shown := (found,)) != self._shown:
            self._shown = shown
            self._text.content = report(found)


def report(found: tuple[PoseBlame, ...]) -> str:
    """As HTML."""
    return render("blame.html", blames=[_card(each) for each in found])


def _card(of: PoseBlame) -> dict[str, Any]:
    unit = unit_of(of)
    rows = [
        {
            "name": of.called(each),
            "size": size(of, each.shift.size, unit),
            "select": str(Selection.of_tracks(of.method, each.part.tracks)) if each.part.tracks else "",
            "seek": of.index_of(each.part.time_ns) if each.part.time_ns is not None else None,
        }
        for each in of.listed()
    ]
    label, colour = colours.label(of.method), colours.css(colours.of(of.method))
    return {"label": label, "colour": colour, "said": answer(of), "rows": rows}


PANELS = (Panel(TAB, 102, BlamePanel),)
