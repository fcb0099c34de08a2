"""Recording a run, opening what was recorded, and keeping notes with it."""

from __future__ import annotations

from typing import ClassVar

from ...session.commands import Command, PageCommand
from ...session.controller import Controller
from ...session.sources.folders import run_name
from .listing import Known
from .service import RecordingService


class OpenNamed(PageCommand, frozen=True):
    """Open the run of this name, if it is one that is known here. A name, never a path."""

    name: str
    keeps: ClassVar[bool] = True

    def execute(self, session: Controller) -> None:
        source = self._source(session)
        session.service(RecordingService).show()  # another process may have finished it
        if session.screen.open(source, None):
            session.screen.play_on()

    def closing(self, session: Controller) -> str:
        return f"Opening {run_name(self._source(session))}"

    def _source(self, session: Controller) -> str:
        return Known(session.setup.recordings).source(self.name, session.state)


class Record(PageCommand, frozen=True):
    """Record the run, from its first frame on, under this name (a name, never a path); empty for a made-up one."""

    name: str = ""

    def execute(self, session: Controller) -> None:
        session.service(RecordingService).record(self.name)


class StopRecording(Command, frozen=True):
    """Write what is left, and close the file."""

    def execute(self, session: Controller) -> None:
        session.service(RecordingService).leave(session.run)


class RepairRecordings(PageCommand, frozen=True):
    """Finish the recordings and runs that a stopped program left unfinished, as far as they came."""

    def execute(self, session: Controller) -> None:
        session.service(RecordingService).repair()


class PutNote(PageCommand, frozen=True):
    """Keep a note with one of the runs and recordings of the list; an empty one removes it."""

    name: str
    """As the list has it."""
    note: str

    def execute(self, session: Controller) -> None:
        session.service(RecordingService).show()  # another process may have finished a run
        session.service(RecordingService).put_note(self.name, self.note)
