"""View: which layers and methods are drawn, in both 3-D views and on the images, and what the colours mean."""

from __future__ import annotations

from typing import TYPE_CHECKING

import viser

from ispom.methods import names
from ispom.types import TrackStatus

from ... import colours
from ...rerun_log.layers import LAYERS
from ...session import commands as do
from ...session.state import State
from ..markup import render

if TYPE_CHECKING:
    from ...session.session import Session


class ViewPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self._boxes = {method: gui.add_checkbox(colours.label(method), True) for method in names()}
        self._boxes |= {name: gui.add_checkbox(label, True) for name, label in LAYERS.items()}
        for box in self._boxes.values():
            box.on_update(lambda _: session.post(do.Hide(self.hidden)))
        gui.add_html(legend())

    @property
    def hidden(self) -> frozenset[str]:
        """Names of layers and methods."""
        return frozenset(name for name, box in self._boxes.items() if not box.value)

    def show(self, state: State) -> None:
        for name, box in self._boxes.items():
            absent = name not in LAYERS and name not in state.methods
            if box.disabled != absent:
                box.disabled = absent


def legend() -> str:
    """What the colours mean, as HTML."""
    methods = [(colours.css(colours.of(m)), colours.label(m)) for m in names()]
    reasons: dict[str, list[str]] = {}
    for status, colour in colours.TRACK.items():
        reasons.setdefault(colours.css(colour), []).append(TrackStatus(status).reason)
    tracks = [(colour, "; ".join(found)) for colour, found in reasons.items()]
    paths = [*methods, (colours.css(colours.TRUTH), "truth")]
    return render("legend.html", groups=[("Paths", paths), ("Tracks", tracks)])
