"""Source: what is open, what was, and what else there is to open."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import viser

from ispom.errors import as_text

from ...session import commands as do
from ...session.sources.folders import Entry
from ...session.state import State
from ...views.viser.controls import ConfigForm
from ...views.viser.panels import Panel

if TYPE_CHECKING:
    from ...session.session import Session

FOLDERS = "▶ marks what can be opened: choosing it fills the field above. Choosing another folder lists what is in it."
HINT = (
    "sim:city, sim:city#3 (another seed), a live camera (camera:0), or a path: of a recording (KITTI, images …), of a "
    "finished run, or of an .rrd file"
)
RECENT = "Sources opened before; choosing one fills the field above."
NONE, UP, MARK = "choose …", ".. (up)", "▶ "
NOTHING: tuple[str, ...] = (NONE,)


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
            self._recent = gui.add_dropdown("recent", NOTHING, initial_value=NONE, hint=RECENT)
            self._recent.on_update(lambda _: self._choose(self._recent.value))
            self._browse = gui.add_dropdown("folders", NOTHING, initial_value=NONE, hint=FOLDERS)
            self._browse.on_update(lambda _: self._enter(self._browse.value))
            with gui.add_folder("Options of the source", expand_by_default=False):
                self._options = ConfigForm(gui, session.state.source_options)
        self._usual, self._other = session.state.source_options, False
        """The options that the app was started with, and whether the field names another source than the one shown."""
        self._entries: dict[str, Entry] = {}
        self._look_into(session.folders.home)

    def show(self, state: State) -> None:
        before, self._state = self._state, state
        if before is None or state.recent != before.recent:
            self._recent.options = (*NOTHING, *state.recent)
            self._recent.value = NONE
        if before is None or state.run != before.run:
            self._source.value = state.source
            self._options.show(state.source_options)

    def _open(self, _: object) -> None:
        self._session.post(do.Open(self._source.value.strip(), self._options.value))

    def _named(self) -> None:
        """Options of the source that is shown are its own: for another one, they become the usual ones in sight."""
        state = self._state or self._session.state
        other = self._source.value.strip() != state.source
        if other and not self._other:
            written, shown = self._options.value, state.source_options
            names = [f.name for f in fields(written) if getattr(written, f.name) == getattr(shown, f.name)]
            self._options.show(replace(written, **{name: getattr(self._usual, name) for name in names}))
        self._other = other

    def _choose(self, name: str) -> None:
        if name != NONE:
            self._source.value = name

    def _enter(self, name: str) -> None:
        """What can be opened comes into the field above; another folder is looked into."""
        entry = self._entries.get(name)
        if name == UP:
            self._look_into(self._session.folders.above(self._folder) or self._folder)
        elif entry is not None and entry.source:
            self._source.value = str(entry.path)
        elif entry is not None:
            self._look_into(entry.path)

    def _look_into(self, folder: Path) -> None:
        folders, self._folder = self._session.folders, folder
        self._entries = {f"{MARK if e.source else ''}{e.path.name}": e for e in folders.entries(folder)}
        up = (UP,) if folders.above(folder) else ()
        self._browse.options = (f"in {as_text(folder.name or folder)}: choose …", *up, *self._entries)
        self._browse.value = self._browse.options[0]


PANELS = (Panel("", 10, SourcePanel),)
