"""Asking for the cause of what went wrong at a frame, and cancelling that."""

from __future__ import annotations

from ...session.commands import PageCommand
from ...session.controller import Controller
from .service import DoctorService


class Examine(PageCommand, frozen=True):
    """Examines the stretch around a frame of the run that is shown; None: around the frame that is shown."""

    at: int | None = None
    thorough: bool = False
    """Whether it has the time to try settings, too."""

    def execute(self, session: Controller) -> None:
        session.service(DoctorService).start(self.at, thorough=self.thorough)


class ForkWithRemedy(PageCommand, frozen=True):
    """Runs on from the state before the stretch that was examined, as a branch, with the setting that helped there."""

    def execute(self, session: Controller) -> None:
        session.service(DoctorService).fork_with_remedy()
        session.store.set(playing=True)


class CancelExamination(PageCommand, frozen=True):
    """Ends the examination without an answer."""

    def execute(self, session: Controller) -> None:
        session.service(DoctorService).cancel()
