"""Opening what the start screen names, and comparing two runs of the table."""

from __future__ import annotations

from ispom.sequences.address import without_secrets

from ...session.commands import PageCommand
from ...session.controller import Controller
from ...session.registry import handles
from .service import RunsService


class OpenSource(PageCommand, frozen=True):
    """Open another source as the command line said, and play it: `sim:NAME`, an address, or a path."""

    source: str


class CompareRuns(PageCommand, frozen=True):
    """Show one run and compare it with another one. Those of the recordings folder are opened for that."""

    a: str
    """As the runs table has it: `live:` and the number of a branch, or a name in the recordings folder."""
    b: str


@handles(OpenSource, closing=lambda session, command: f"Opening {without_secrets(command.source)}")
def open_source(session: Controller, command: OpenSource) -> None:
    if session.open(command.source.strip(), None):
        session.play_on()


def _closing(session: Controller, command: CompareRuns) -> str:
    runs = session.service(RunsService)
    inside = [runs.branch_of(key) is not None for key in (command.a, command.b)]
    return "" if any(inside) else f"Comparing {command.a} and {command.b}"


@handles(CompareRuns, closing=_closing)
def compare_runs(session: Controller, command: CompareRuns) -> None:
    session.service(RunsService).compare(command.a, command.b)
