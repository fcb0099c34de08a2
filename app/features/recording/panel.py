"""Record: on and off, name and size, and the recordings that there are."""

from __future__ import annotations

from dataclasses import asdict
from importlib.metadata import version
from typing import TYPE_CHECKING

import viser

from ...presentation.texts import size
from ...session import commands as do
from ...session.state import State
from ...views.viser.markup import renderer
from ...views.viser.panels import Panel
from ..bookmarks.notes import NOTE_LENGTH
from .commands import PutNote, Record, RepairRecordings, StopRecording
from .state import Kept, Recordings

if TYPE_CHECKING:
    from ...session.session import Session

render = renderer(__package__)

START, STOP = "Record", "Stop recording"
NONE: tuple[str, ...] = ("none yet",)
RECORD = "Writes the run, from its first exposure on, into a file of the folder recordings; again: closes the file."
REVIEW = "Shows it in this page as it was; nothing is computed. It takes the place of the run that is shown."
VIEWER = ".".join(version("rerun-sdk").split(".")[:2])


class RecordPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self._name = gui.add_text("name", "", hint="File name without folders; leave empty to generate one.")
        self._button = gui.add_button(START, icon=viser.Icon.PLAYER_RECORD, color="red", hint=RECORD)
        self._button.on_click(self._clicked)
        self._repair = gui.add_button(
            "Repair unfinished recordings",
            visible=bool(session.state[Recordings].unfinished),
            hint="An app that was stopped left them without an index: they become readable up to where it came.",
        )
        self._repair.on_click(lambda _: session.post(RepairRecordings()))
        self._text = gui.add_html(_text(session.state))
        self._kept: tuple[Kept, ...] = ()
        with gui.add_folder("Review", visible=False) as self._folder:
            self._choice = gui.add_dropdown("run", NONE, hint="Of the runs and recordings of the list above.")
            self._choice.on_update(lambda _: self._fill())
            review = gui.add_button("Open for review", icon=viser.Icon.FOLDER_OPEN, hint=REVIEW)
            review.on_click(lambda _: session.post(do.OpenNamed(self._choice.value)))
            self._note = gui.add_text("its note", "", hint=f"Kept with the run or recording; {NOTE_LENGTH} characters.")
            keep = gui.add_button("Keep note", icon=viser.Icon.PENCIL, hint="Writes it; an empty note is removed.")
            keep.on_click(lambda _: session.post(PutNote(self._choice.value, self._note.value)))

    def _clicked(self, _: object) -> None:
        recording = self._session.state[Recordings].current
        self._session.post(StopRecording() if recording else Record(self._name.value))

    def show(self, state: State) -> None:
        label = STOP if state[Recordings].current else START
        if self._button.label != label:
            self._button.label = label
            self._name.disabled = state[Recordings].current is not None
        self._offer(state[Recordings].listed)
        if self._repair.visible != bool(state[Recordings].unfinished):
            self._repair.visible = bool(state[Recordings].unfinished)
        if (text := _text(state)) != self._text.content:
            self._text.content = text

    def _offer(self, kept: tuple[Kept, ...]) -> None:
        if kept == self._kept:
            return
        self._kept, before = kept, self._choice.value
        names = tuple(each.name for each in kept) or NONE
        self._choice.options = names
        self._choice.value = before if before in names else names[0]
        self._folder.visible = bool(kept)
        self._fill()

    def _fill(self) -> None:
        """The note, as the chosen one has it."""
        self._note.value = next((each.note for each in self._kept if each.name == self._choice.value), "")


def _text(state: State) -> str:
    """What is recorded now, and links to the files, as HTML."""
    text = f"Records the run from its first exposure, whenever you start. The file opens in any Rerun {VIEWER} viewer."
    recordings = state[Recordings]
    if recording := recordings.current:
        doing = "Closing" if recording.closing else "Recording"
        done = f"{recording.written} of {state.computed} exposures"
        text = f"{doing} {recording.name}: {done}, {size(recording.size_bytes)}"
    files = [asdict(kept) | {"size": size(kept.size_bytes), "about": _about(kept)} for kept in recordings.listed]
    return render("recordings.html", text=text, files=files, unfinished=recordings.unfinished)


def _about(kept: Kept) -> str:
    """What it is of, and how long."""
    length = f"{kept.exposures} exposures" if kept.exposures else ""
    return ", ".join(filter(None, (kept.source, length, f"{kept.duration_s:.1f} s" if kept.duration_s else "")))


PANELS = (Panel("Files", 700, RecordPanel),)
