"""Recording a run, opening what was recorded, and keeping notes with it."""

from __future__ import annotations

from ...session.commands import Command, PageCommand
from ...session.controller import Controller
from ...session.registry import handles
from ...session.sources.folders import run_name
from .listing import Known
from .service import RecordingService


class OpenNamed(PageCommand, frozen=True):
    """Open the run of this name, if it is one that is known here. A name, never a path."""

    name: str


class Record(PageCommand, frozen=True):
    """Record the run, from its first frame on, under this name (a name, never a path); empty for a made-up one."""

    name: str = ""


class StopRecording(Command, frozen=True):
    """Write what is left, and close the file."""


class RepairRecordings(Command, frozen=True):
    """Finish the recordings that a stopped app left unfinished: they get their index, and their name."""


class PutNote(PageCommand, frozen=True):
    """Keep a note with one of the runs and recordings of the list; an empty one removes it."""

    name: str
    """As the list has it."""
    note: str


def _source(session: Controller, command: OpenNamed) -> str:
    return Known(session.recordings).source(command.name, session.state)


@handles(OpenNamed, closing=lambda session, command: f"Opening {run_name(_source(session, command))}")
def open_named(session: Controller, command: OpenNamed) -> None:
    source = _source(session, command)
    session.service(RecordingService).show()  # another process may have finished it
    if session.open(source, None):
        session.play_on()


@handles(Record)
def record(session: Controller, command: Record) -> None:
    session.service(RecordingService).record(command.name)


@handles(StopRecording)
def stop_recording(session: Controller, command: StopRecording) -> None:
    session.service(RecordingService).leave(session.run)


@handles(RepairRecordings)
def repair_recordings(session: Controller, command: RepairRecordings) -> None:
    session.service(RecordingService).repair()


@handles(PutNote)
def put_note(session: Controller, command: PutNote) -> None:
    session.service(RecordingService).show()  # another process may have finished a run
    session.service(RecordingService).put_note(command.name, command.note)
