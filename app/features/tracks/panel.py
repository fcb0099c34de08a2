"""The tab Tracks."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, get_args

import viser

from ...engine.inspection.colouring import COLOURINGS
from ...engine.inspection.looked import Looked
from ...engine.inspection.selection import parsed
from ...session.commands import Command
from ...session.state import State
from ...views.viser.panels import Panel, renderer
from ..layers.commands import ColourBy
from ..layers.state import Layers
from .commands import Inspection, LookAt, PanelName
from .geometry import geometry_report
from .key_frames import key_frames_report
from .residuals import residuals_report
from .track import TrackChips, track_report
from .track_picture import track_picture
from .tracks import lifetimes_chart, tracks_table

if TYPE_CHECKING:
    from ...session.session import Session


render = renderer(__package__)

NAME = "Tracks"
PANEL_HINT = (
    "What stands below: the selected track, a table of all, their lifetimes, keyframes by shared tracks, residuals "
    "[px], or the geometry of the latest triple and pair."
)
PLAYING_S = 1.0
"""Interval between two images while the run goes on."""
CAMERAS = {"video": "video", "left": "left image"}
EMPTY = '<div style="padding:4px 14px;font-size:12px">Nothing is computed yet. Press Play, or step forward (→).</div>'


class LookTab:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._chips, self._showing = session, TrackChips(), False
        self._camera = gui.add_button_group("image", tuple(CAMERAS.values()), hint="Whose picture is shown.")
        self._camera.on_click(lambda _: session.post(LookAt(camera=_key(CAMERAS, self._camera.value))))
        hint = "What the colours of tracks mean, here and in the images at the right."
        self._colour_by = gui.add_dropdown("colour by", COLOURINGS, initial_value="state", hint=hint)
        self._colour_by.on_update(lambda _: self._post(ColourBy(self._colour_by.value)))
        self._picture = gui.add_html(EMPTY)
        self._panel = gui.add_dropdown("show", get_args(PanelName), initial_value="track", hint=PANEL_HINT)
        self._panel.on_update(lambda _: self._post(LookAt(panel=self._panel.value)))
        self._text = gui.add_html("")
        self._drawn: tuple[Any, ...] = ()
        self._due_s = 0.0

    def _post(self, command: Command) -> None:
        if not self._showing:
            self._session.post(command)

    def show(self, state: State) -> None:
        """The controls alone: see `refresh` for what takes longer."""
        self._showing = True
        try:
            if self._colour_by.value != state[Layers].colour_by:
                self._colour_by.value = state[Layers].colour_by
            if self._panel.value != state[Inspection].panel:
                self._panel.value = state[Inspection].panel
        finally:
            self._showing = False

    def refresh(self, state: State) -> None:
        """Draws what the state shows, where that has changed and it is time."""
        values = (
            state.run,
            state.displayed,
            state[Inspection].selected,
            state[Inspection].camera,
            state[Layers].colour_by,
            state[Inspection].panel,
        )
        if values == self._drawn or (state.playing and time.monotonic() < self._due_s):
            return
        self._drawn = values
        looked = looked_at(self._session, state)
        recorded = self._session.run.recorded if self._session.run is not None else None
        texts = (
            (EMPTY, "")
            if looked is None
            else (track_picture(looked, recorded), self._report(state[Inspection].panel, looked))
        )
        for handle, text in zip((self._picture, self._text), texts, strict=True):
            if handle.content != text:
                handle.content = text
        self._due_s = time.monotonic() + PLAYING_S

    def _report(self, look: str, looked: Looked) -> str:
        if looked.missing:
            return render("note.html", text=looked.missing)
        if look == "track":
            return track_report(looked, self._chips)
        drawn = {"tracks": tracks_table, "lifetimes": lifetimes_chart, "keyframes": key_frames_report}
        drawn |= {"residuals": residuals_report, "geometry": geometry_report}
        return drawn[look](looked)


def looked_at(session: Session, state: State) -> Looked | None:
    """What the closer look is drawn from; None before the first frame."""
    run = session.run
    if run is None or state.displayed is None or state.displayed.index >= len(run.history):
        return None
    return Looked(
        run.opened.sequence,
        run.history,
        run.series,
        run.known_at,
        state.displayed,
        parsed(state[Inspection].selected),
        state[Inspection].camera,
        state[Layers].colour_by,
        run.stored.unavailable if run.stored is not None else "",
        run.is_recorded(state.displayed.index),
    )


def _key(names: dict[str, str], value: str) -> str:
    return next(key for key, name in names.items() if name == value)


PANELS = (Panel(NAME, 200, LookTab),)
