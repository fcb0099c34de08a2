"""Record: on and off, name and size, and the recordings that there are."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING
from urllib.parse import quote

import viser

from ...session import commands as do
from ...session.state import RecordedFile, State

if TYPE_CHECKING:
    from ...session.session import Session

START, STOP = "Record", "Stop recording"


class RecordPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self._name = gui.add_text("name", "", hint="a name, not a path; empty: one is made up")
        self._button = gui.add_button(START, icon=viser.Icon.PLAYER_RECORD, color="red")
        self._button.on_click(self._clicked)
        self._text = gui.add_markdown("")
        self._list = gui.add_html("")
        self._files: tuple[RecordedFile, ...] | None = None

    def _clicked(self, _: object) -> None:
        recording = self._session.state.recording
        self._session.post(do.StopRecording() if recording else do.Record(self._name.value))

    def show(self, state: State) -> None:
        recording = state.recording
        label = STOP if recording else START
        if self._button.label != label:
            self._button.label = label
            self._name.disabled = recording is not None
        if recording:
            doing = "Closing" if recording.closing else "Recording"
            done = f"{recording.written} of {state.computed} exposures"
            text = f"{doing} **{recording.name}**: {done}, {size(recording.size_bytes)}"
        else:
            text = "Records the run from its first exposure on, whenever you start. Opens in any Rerun 0.41 viewer."
        if self._text.content != text:
            self._text.content = text
        if state.recordings is not self._files:
            self._files = state.recordings
            self._list.content = listing(state.recordings)


def listing(files: tuple[RecordedFile, ...]) -> str:
    """Links to the files, as HTML."""
    if not files:
        return '<div style="padding:4px 14px;font-size:12px;opacity:.7">No recordings yet.</div>'
    rows = "".join(
        '<div style="display:flex;gap:8px"><a style="flex:1;color:inherit" download '
        f'href="../recordings/{quote(f.name)}">{escape(f.name)}</a><span>{size(f.size_bytes)}</span></div>'
        for f in files
    )
    return f'<div style="padding:4px 14px;font-size:12px"><b>Recordings</b>{rows}</div>'


def size(count: int) -> str:
    """Bytes for people."""
    return f"{count / 1e3:.0f} kB" if count < 1e6 else f"{count / 1e6:.1f} MB"
