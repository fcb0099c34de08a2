"""Marking frames."""

from __future__ import annotations

from ...session.actions import Action, offer
from ...session.commands import Command, PageCommand
from ...session.controller import Controller
from ...session.registry import handles
from .service import BookmarkService


class PutBookmark(Command, frozen=True):
    """Mark the frame that is shown; None keeps the note that is there."""

    note: str | None = None


class ToggleBookmark(PageCommand, frozen=True):
    """Mark the frame that is shown; if it has a mark without a note, remove that."""


class RemoveBookmark(Command, frozen=True):
    frame: int


hint = "Marks the frame shown; again: removes a mark without a note."
offer(Action(150, "bookmark", "m", "Bookmark", hint, ToggleBookmark()))


@handles(PutBookmark)
def put_bookmark(session: Controller, command: PutBookmark) -> None:
    session.service(BookmarkService).put(command.note)


@handles(ToggleBookmark)
def toggle_bookmark(session: Controller, command: ToggleBookmark) -> None:
    session.service(BookmarkService).toggle()


@handles(RemoveBookmark)
def remove_bookmark(session: Controller, command: RemoveBookmark) -> None:
    session.service(BookmarkService).remove(command.frame)
