"""Running a method with several values of a setting."""

from __future__ import annotations

from ...session.commands import Command
from ...session.controller import Controller
from .service import SweepService


class RunSweep(Command, frozen=True):
    """Run a method of the source with each of a few values of a setting, while the page goes on."""

    method: str
    setting: str
    """As a field of its config."""
    values: str
    """As they were written: `100, 200, 400`."""

    def execute(self, session: Controller) -> None:
        session.service(SweepService).start(self.method, self.setting, self.values)


class CancelSweep(Command, frozen=True):
    """No further; what was computed stays."""

    def execute(self, session: Controller) -> None:
        session.service(SweepService).cancel()


class ShowSwept(Command, frozen=True):
    """Show the run of a value as a branch of the run that is shown."""

    place: int
    """Of the value, counted from 0."""

    def execute(self, session: Controller) -> None:
        session.service(SweepService).show(self.place)
