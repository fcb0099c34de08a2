"""Recording: on and off, its name and size. What was recorded is in the runs table."""

from __future__ import annotations

from importlib.metadata import version
from typing import TYPE_CHECKING

import viser

from ...presentation.texts import size
from ...session.state import State
from ...views.viser.panels import Panel, renderer
from .commands import Record, StopRecording
from .state import Recordings

if TYPE_CHECKING:
    from ...session.session import Session

render = renderer(__package__)

START, STOP = "Record", "Stop recording"
RECORD = "Writes the run, from its first frame on, into a file of the folder recordings; again: closes the file."
VIEWER = ".".join(version("rerun-sdk").split(".")[:2])


class RecordPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self._name = gui.add_text("name", "", hint="File name without folders; leave empty to generate one.")
        self._button = gui.add_button(START, icon=viser.Icon.PLAYER_RECORD, color="red", hint=RECORD)
        self._button.on_click(self._clicked)
        self._text = gui.add_html(_text(session.state))

    def _clicked(self, _: object) -> None:
        recording = self._session.state[Recordings].current
        self._session.post(StopRecording() if recording else Record(self._name.value))

    def show(self, state: State) -> None:
        label = STOP if state[Recordings].current else START
        if self._button.label != label:
            self._button.label = label
            self._name.disabled = state[Recordings].current is not None
        if (text := _text(state)) != self._text.content:
            self._text.content = text


def _text(state: State) -> str:
    """What is recorded now, as HTML."""
    text = f"Records the run from its first frame, whenever you start. The file opens in any Rerun {VIEWER} viewer."
    if recording := state[Recordings].current:
        doing = "Closing" if recording.closing else "Recording"
        done = f"{recording.written} of {state.computed} frames"
        text = f"{doing} {recording.name}: {done}, {size(recording.size_bytes)}"
    return render("recordings.html", text=text)


PANELS = (Panel("Files", 700, RecordPanel),)
