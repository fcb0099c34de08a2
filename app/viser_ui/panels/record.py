"""Record: on and off, name and size, and the recordings that there are."""

from __future__ import annotations

from importlib.metadata import version
from typing import TYPE_CHECKING

import viser

from ...session import commands as do
from ...session.sources.known import reviewed, run_name
from ...session.state import State
from ...texts import size
from ..markup import render

if TYPE_CHECKING:
    from ...session.session import Session

START, STOP = "Record", "Stop recording"
NONE: tuple[str, ...] = ("none yet",)
VIEWER = ".".join(version("rerun-sdk").split(".")[:2])


class RecordPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self._name = gui.add_text("name", "", hint="File name without folders; leave empty to generate one.")
        self._button = gui.add_button(START, icon=viser.Icon.PLAYER_RECORD, color="red")
        self._button.on_click(self._clicked)
        self._repair = gui.add_button(
            "Repair unfinished recordings",
            visible=bool(session.state.unfinished),
            hint="An app that was stopped left them without an index: they become readable up to where it came.",
        )
        self._repair.on_click(lambda _: session.post(do.RepairRecordings()))
        self._text = gui.add_html(_text(session.state))
        self._choice = gui.add_dropdown("to review", NONE, visible=False, hint="Runs and recordings of the list above.")
        self._review = gui.add_button("Open for review", icon=viser.Icon.FOLDER_OPEN, visible=False)
        self._review.on_click(lambda _: session.post(do.OpenNamed(run_name(self._choice.value))))

    def _clicked(self, _: object) -> None:
        recording = self._session.state.recording
        self._session.post(do.StopRecording() if recording else do.Record(self._name.value))

    def show(self, state: State) -> None:
        label = STOP if state.recording else START
        if self._button.label != label:
            self._button.label = label
            self._name.disabled = state.recording is not None
        names = tuple(dict.fromkeys(reviewed(file.name) for file in state.recordings)) or NONE
        if names != tuple(self._choice.options):
            self._choice.options = names
            self._choice.value = names[0]
            self._choice.visible = self._review.visible = names != NONE
        if self._repair.visible != bool(state.unfinished):
            self._repair.visible = bool(state.unfinished)
        if (text := _text(state)) != self._text.content:
            self._text.content = text


def _text(state: State) -> str:
    """What is recorded now, and links to the files, as HTML."""
    text = f"Records the run from its first exposure, whenever you start. The file opens in any Rerun {VIEWER} viewer."
    if state.recording:
        recording = state.recording
        doing = "Closing" if recording.closing else "Recording"
        done = f"{recording.written} of {state.computed} exposures"
        text = f"{doing} {recording.name}: {done}, {size(recording.size_bytes)}"
    files = [{"name": f.name, "size": size(f.size_bytes), "about": f.about} for f in state.recordings]
    return render("recordings.html", text=text, files=files, unfinished=state.unfinished)
