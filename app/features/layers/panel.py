"""View: which layers and methods are drawn, in both 3-D views and on the images, and what the colours mean."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import viser

from ispom.methods import names
from ispom.types import TrackStatus

from ...presentation import colours
from ...session.state import State
from ...views.rerun.layers import HINTS, LAYERS, OPTIONAL
from ...views.viser.panels import Panel, renderer
from .commands import Choose, Hide
from .state import Layers, offered

if TYPE_CHECKING:
    from ...session.session import Session

render = renderer(__package__)

METHOD_HINT = "Draws what the method made: path, camera, keyframes, points."


class ViewPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._showing, self._seen = session, False, session.state[Layers].undrawn
        self._requested_layers: set[frozenset[str]] = set()
        """The choices made here that are not shown yet."""
        self._of: tuple[int, tuple[str, ...]] = (-1, ())
        """The run and the methods that the boxes and the legend are of."""
        self._boxes = {m: gui.add_checkbox(colours.label(m), True, hint=METHOD_HINT, visible=False) for m in names()}
        drawn = {name: name not in OPTIONAL for name in LAYERS}
        self._boxes |= {name: gui.add_checkbox(LAYERS[name], on, hint=HINTS[name]) for name, on in drawn.items()}
        for name, box in self._boxes.items():
            box.on_update(lambda _, name=name: self._clicked(name))
        self._legend = gui.add_html(legend(()))

    @property
    def undrawn(self) -> frozenset[str]:
        """Names of layers and methods."""
        return frozenset(name for name, box in self._boxes.items() if not box.value)

    def _clicked(self, name: str) -> None:
        if not self._showing:
            undrawn = self.undrawn
            self._requested_layers.add(undrawn)
            self._session.post(Choose(OPTIONAL - undrawn) if name in OPTIONAL else Hide(undrawn - OPTIONAL))

    def show(self, state: State) -> None:
        undrawn = state[Layers].undrawn
        if undrawn != self._seen:
            self._seen = undrawn
            if undrawn in self._requested_layers:
                self._requested_layers.clear()
            else:
                self._follow(undrawn)
        if (state.run, state.methods) != self._of:
            self._of = state.run, state.methods
            self._legend.content = legend(state.methods)
            opened = self._session.opened
            layers = LAYERS if opened is None else offered(opened, state.methods)
            for name, box in self._boxes.items():
                box.visible = name in state.methods or name in layers

    def _follow(self, undrawn: frozenset[str]) -> None:
        """The boxes, where somebody else hid or chose something: the page's address."""
        self._showing = True
        try:
            for name, box in self._boxes.items():
                box.value = name not in undrawn
        finally:
            self._showing = False


def legend(methods: Iterable[str]) -> str:
    """What the colours mean where these methods run, as HTML."""
    running = [(colours.css(colours.of(m)), colours.label(m)) for m in methods]
    reasons: dict[str, list[str]] = {}
    for status, colour in colours.TRACK.items():
        reasons.setdefault(colours.css(colour), []).append(TrackStatus(status).reason)
    tracks = [(colour, "; ".join(found)) for colour, found in reasons.items()]
    paths = [*running, (colours.css(colours.TRUTH), "ground truth")]
    return render("legend.html", groups=[("Paths", paths), ("Tracks", tracks)])


PANELS = (Panel("View", 610, ViewPanel),)
