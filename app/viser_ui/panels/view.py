"""View: which layers and methods are drawn, in both 3-D views and on the images, and what the colours mean."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import viser

from ispom.methods import names
from ispom.types import TrackStatus

from ... import colours
from ...rerun_log.layers import LAYERS
from ...session import commands as do
from ...session.state import State

if TYPE_CHECKING:
    from ...session.session import Session

log = logging.getLogger(__name__)


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
        for method in names():
            if self._boxes[method].disabled != (method not in state.methods):
                self._boxes[method].disabled = method not in state.methods


def legend() -> str:
    """What the colours mean, as HTML."""
    methods = [(colours.of(m), colours.label(m)) for m in names()] + [(colours.TRUTH, "truth")]
    by_colour: dict[colours.Rgb, list[str]] = {}
    for status, colour in colours.TRACK.items():
        by_colour.setdefault(colour, []).append(TrackStatus(status).reason)
    tracks = [(colour, "; ".join(reasons)) for colour, reasons in by_colour.items()]
    return f'<div style="padding:4px 14px 10px;font-size:12px">{_list("Paths", methods)}{_list("Tracks", tracks)}</div>'


def _list(title: str, items: list[tuple[colours.Rgb, str]]) -> str:
    rows = "".join(
        f'<div style="display:flex;gap:8px;align-items:baseline"><i style="width:9px;height:9px;border-radius:50%;'
        f'flex:none;background:{colours.css(colour)}"></i><span>{text}</span></div>'
        for colour, text in items
    )
    return f'<div style="font-weight:600;margin:8px 0 3px">{title}</div>{rows}'
