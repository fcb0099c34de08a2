"""View: which layers and methods are drawn, in both 3-D views and on the images, and what the colours mean."""

from __future__ import annotations

from typing import TYPE_CHECKING

import viser

from ispom.methods import names
from ispom.types import TrackStatus

from ...presentation import colours
from ...session.state import State
from ...views.rerun.layers import HINTS, LAYERS
from ...views.viser.markup import renderer
from ...views.viser.panels import Panel
from .commands import Hide
from .state import Layers

if TYPE_CHECKING:
    from ...session.session import Session

render = renderer(__package__)

METHOD_HINT = "Draws what the method made: path, camera, keyframes, points."


class ViewPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._showing, self._seen = session, False, session.state[Layers].hidden
        self._asked: set[frozenset[str]] = set()
        """What was asked for here, and is not shown yet."""
        self._boxes = {m: gui.add_checkbox(colours.label(m), True, hint=METHOD_HINT) for m in names()}
        self._boxes |= {name: gui.add_checkbox(label, True, hint=HINTS[name]) for name, label in LAYERS.items()}
        for box in self._boxes.values():
            box.on_update(lambda _: self._clicked())
        gui.add_html(legend())

    @property
    def hidden(self) -> frozenset[str]:
        """Names of layers and methods."""
        return frozenset(name for name, box in self._boxes.items() if not box.value)

    def _clicked(self) -> None:
        if not self._showing:
            self._asked.add(self.hidden)
            self._session.post(Hide(self.hidden))

    def show(self, state: State) -> None:
        if state[Layers].hidden != self._seen:
            self._seen = state[Layers].hidden
            if state[Layers].hidden in self._asked:
                self._asked.clear()
            else:
                self._follow(state[Layers].hidden)
        for name, box in self._boxes.items():
            absent = name not in LAYERS and name not in state.methods
            if box.disabled != absent:
                box.disabled = absent

    def _follow(self, hidden: frozenset[str]) -> None:
        """The boxes, where somebody else hid something: the page's address."""
        self._showing = True
        try:
            for name, box in self._boxes.items():
                box.value = name not in hidden
        finally:
            self._showing = False


def legend() -> str:
    """What the colours mean, as HTML."""
    methods = [(colours.css(colours.of(m)), colours.label(m)) for m in names()]
    reasons: dict[str, list[str]] = {}
    for status, colour in colours.TRACK.items():
        reasons.setdefault(colours.css(colour), []).append(TrackStatus(status).reason)
    tracks = [(colour, "; ".join(found)) for colour, found in reasons.items()]
    paths = [*methods, (colours.css(colours.TRUTH), "truth")]
    return render("legend.html", groups=[("Paths", paths), ("Tracks", tracks)])


PANELS = (Panel("View", 610, ViewPanel),)
