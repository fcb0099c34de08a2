"""Marking frames."""

from __future__ import annotations

from ...session.actions import Action, offer
from ...session.commands import Command, PageCommand
from ...session.controller import Controller
from .service import BookmarkService


class PutBookmark(Command, frozen=True):
    """Mark the frame that is shown; None keeps the note that is there."""

    note: str | None = None

    def execute(self, session: Controller) -> None:
        session.service(BookmarkService).put(self.note)


class ToggleBookmark(PageCommand, frozen=True):
    """Mark the frame that is shown; if it has a mark without a note, remove that."""

    def execute(self, session: Controller) -> None:
        session.service(BookmarkService).toggle()


class RemoveBookmark(Command, frozen=True):
    frame: int

    def execute(self, session: Controller) -> None:
        session.service(BookmarkService).remove(self.frame)


hint = "Marks the frame shown; again: removes a mark without a note."
offer(Action(150, "bookmark", "m", "Bookmark", hint, ToggleBookmark()))
