"""Opening what the start screen names, and comparing two runs of the table."""

from __future__ import annotations

from typing import ClassVar

from ispom.sequences.address import without_secrets

from ...session.commands import PageCommand
from ...session.controller import Controller
from .service import RunsService


class OpenSource(PageCommand, frozen=True):
    """Open another source with the options of the command line, and play it: `sim:NAME`, an address, or a path."""

    source: str
    keeps: ClassVar[bool] = True

    def execute(self, session: Controller) -> None:
        if session.screen.open(self.source.strip(), None):
            session.screen.play_on()

    def closing(self, session: Controller) -> str:
        return f"Opening {without_secrets(self.source)}"


class ShowKept(PageCommand, frozen=True):
    """Show a run again that was closed when another source was opened."""

    key: str
    """As the runs table has it."""
    keeps: ClassVar[bool] = True

    def execute(self, session: Controller) -> None:
        session.service(RunsService).show_kept(self.key)

    def closing(self, session: Controller) -> str:
        return "Opening another run"


class CompareRuns(PageCommand, frozen=True):
    """Show one run and compare it with another one. Those of the recordings folder are opened for that."""

    a: str
    """As the runs table has it: `live:` and the number of a branch, or a name in the recordings folder."""
    b: str
    keeps: ClassVar[bool] = True

    def execute(self, session: Controller) -> None:
        session.service(RunsService).compare(self.a, self.b)

    def closing(self, session: Controller) -> str:
        runs = session.service(RunsService)
        inside = [runs.branch_of(key) is not None for key in (self.a, self.b)]
        return "" if any(inside) else f"Comparing {self.a} and {self.b}"
