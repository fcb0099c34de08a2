"""Bookmarks on the time axis."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.web.time_axis import Mark, Marks
from .service import Bookmarks


class BookmarkMarks(Marks):
    name: ClassVar[str] = "bookmarks"
    sign: ClassVar[Literal["diamond"]] = "diamond"

    def marked(self, state: State, run: CurrentRun) -> Iterator[Mark]:
        for each in state[Bookmarks].marks:
            yield Mark(each.exposure, f"bookmark: {each.note}" if each.note else "bookmark", each.note)


MARKS = (BookmarkMarks,)
