"""Asking what moved the pose shown."""

from __future__ import annotations

from typing import ClassVar

from ...session.commands import PageCommand
from ...session.controller import Controller
from .service import BlameService


class AskBlame(PageCommand, frozen=True):
    """Find out what moved the poses of the frame that is shown, and by how much."""

    newest_only: ClassVar[bool] = True

    def execute(self, session: Controller) -> None:
        session.service(BlameService).ask()
