"""Opening a source with options of its own; the start screen opens sources with the options of the command line."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING

import viser

from ...session import commands as do
from ...session.state import State
from ...views.viser.controls import ConfigForm
from ...views.viser.panels import Panel

if TYPE_CHECKING:
    from ...session.session import Session

HINT = (
    "sim:city, sim:city#3 (another seed), a live camera (camera:0), or a path: of a recording (KITTI, images …), of a "
    "finished run, or of an .rrd file"
)


class SourcePanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self._state: State | None = None
        self.folder = gui.add_folder("Source", expand_by_default=False)
        with self.folder:
            self._source = gui.add_text("source", session.state.source, hint=HINT)
            self._source.on_update(lambda _: self._named())
            hint = "Opens the source with the options below. Branches that would be lost are asked about first."
            gui.add_button("Open", icon=viser.Icon.FOLDER_OPEN, hint=hint).on_click(self._open)
            self._options = ConfigForm(gui, session.state.source_options)
        self._usual, self._other = session.state.source_options, False
        """The options that the app was started with, and whether the field names another source than the one shown."""

    def show(self, state: State) -> None:
        before, self._state = self._state, state
        if before is None or state.run != before.run:
            self._source.value = state.source
            self._options.show(state.source_options)

    def _open(self, _: object) -> None:
        self._session.post(do.Open(self._source.value.strip(), self._options.value))

    def _named(self) -> None:
        """Options of the source that is shown are its own: for another one, the form shows the usual ones again."""
        state = self._state or self._session.state
        other = self._source.value.strip() != state.source
        if other and not self._other:
            written, shown = self._options.value, state.source_options
            names = [f.name for f in fields(written) if getattr(written, f.name) == getattr(shown, f.name)]
            self._options.show(replace(written, **{name: getattr(self._usual, name) for name in names}))
        self._other = other


PANELS = (Panel("", 10, SourcePanel),)
