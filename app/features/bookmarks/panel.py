"""Bookmarks: frames that somebody marked, with notes; go there, or remove them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import viser

from ...engine.events import Bookmark
from ...session import commands as do
from ...session.state import State
from ...views.viser.panels import Panel
from .commands import PutBookmark, RemoveBookmark
from .notes import NOTE_LENGTH
from .service import Bookmarks

if TYPE_CHECKING:
    from ...session.session import Session

GO, REMOVE = "Go to", "Remove"
NONE: tuple[str, ...] = ("no bookmarks",)
HINT = "Marks the frame shown; the note is kept with the run. Key: m, which also removes one without a note."


class BookmarksPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._bookmarks = session, ()
        with gui.add_folder("Bookmarks"):
            self._note = gui.add_text("note", "", hint=f"Up to {NOTE_LENGTH} characters.")
            self._put = gui.add_button("Bookmark this frame", icon=viser.Icon.BOOKMARK, hint=HINT)
            self._put.on_click(lambda _: session.post(PutBookmark(self._note.value or None)))
            self._choice = gui.add_dropdown("bookmark", NONE, hint="The bookmark for the buttons below.")
            self._buttons = gui.add_button_group("", (GO, REMOVE), hint="Go to: shows its frame. Remove: deletes it.")
            self._buttons.on_click(self._clicked)

    @property
    def _chosen(self) -> Bookmark | None:
        return next((b for b in self._bookmarks if _label(b) == self._choice.value), None)

    def _clicked(self, _: object) -> None:
        if (bookmark := self._chosen) is not None:
            at = bookmark.exposure
            self._session.post(do.Seek(at) if self._buttons.value == GO else RemoveBookmark(at))

    def show(self, state: State) -> None:
        if state[Bookmarks].marks == self._bookmarks:
            return
        before, self._bookmarks = self._bookmarks, state[Bookmarks].marks
        new = [b for b in state[Bookmarks].marks if b not in before]
        selected = [b for b in state[Bookmarks].marks if _label(b) == self._choice.value]
        self._choice.options = tuple(map(_label, state[Bookmarks].marks)) or NONE
        self._choice.value = (
            _label((new or selected or list(state[Bookmarks].marks))[-1]) if state[Bookmarks].marks else NONE[0]
        )
        if new:
            self._note.value = ""


def _label(bookmark: Bookmark) -> str:
    return f"{bookmark.exposure}: {bookmark.note}" if bookmark.note else str(bookmark.exposure)


PANELS = (Panel("Files", 710, BookmarksPanel),)
