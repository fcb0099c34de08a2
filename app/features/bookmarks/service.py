"""The bookmarks of the run on the screen: their state, and what changes it in the worker's thread."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ispom.errors import InputError
from ispom.types import Sequence

from ...engine.events import Bookmark
from ...session.controller import Controller
from ...session.current_run import CurrentRun
from ...session.service import Service
from ...session.state import FeatureState
from .notes import MOST, change_bookmark, notes_path, read_notes, tidy


@dataclass(frozen=True)
class Bookmarks(FeatureState):
    marks: tuple[Bookmark, ...] = ()
    """In the order of their frames."""


class BookmarkService(Service):
    """They belong to the frames: all branches have the same."""

    place = 40

    def __init__(self, session: Controller) -> None:
        super().__init__(session)
        self._path: Path | None = None
        """Where they are kept; None for a live source, whose frames never come again."""
        self._sequence: Sequence | None = None

    def opened(self, run: CurrentRun) -> None:
        """Another run: its bookmarks are those that were kept. InputError if they cannot be read."""
        stored = run.stored.path if run.stored is not None else None
        self._path = None if run.live else notes_path(stored, self.session.setup.recordings, self.state.source)
        self._sequence = run.playback.sequence
        self.store.put(Bookmarks())
        if self._path is not None:
            self.store.put(Bookmarks(read_notes(self._path, run.playback.sequence)))

    def put(self, note: str | None) -> None:
        """At the frame that is shown; None keeps the note that is there. InputError where there is no frame."""
        displayed, marks = self.state.displayed, {b.exposure: b for b in self.state[Bookmarks].marks}
        if displayed is None:
            raise InputError("no frame is shown yet: open a source first")
        before = marks.get(displayed.index)
        if before is None and len(marks) >= MOST:
            raise InputError(f"there are {MOST} bookmarks: remove one first")
        old_note = before.note if before is not None else ""
        marks[displayed.index] = Bookmark(displayed.index, displayed.time_ns, old_note if note is None else tidy(note))
        self._keep(marks, displayed.index)

    def toggle(self) -> None:
        """Removes the mark of the frame that is shown, where it has no note; otherwise as `put`."""
        index = self.state.index
        if any(b.exposure == index and not b.note for b in self.state[Bookmarks].marks):
            self.remove(index)
        else:
            self.put(None)

    def remove(self, exposure: int) -> None:
        """InputError where there is none."""
        marks = {b.exposure: b for b in self.state[Bookmarks].marks}
        if marks.pop(exposure, None) is None:
            raise InputError(f"there is no bookmark at frame {exposure}: choose one of the list")
        self._keep(marks, exposure)

    def _keep(self, marks: dict[int, Bookmark], exposure: int) -> None:
        """Of these marks that of the frame has changed; another app may have changed others in the file."""
        bookmarks = tuple(marks[i] for i in sorted(marks))
        try:
            if self._path is not None and self._sequence is not None:
                bookmarks = change_bookmark(self._path, self._sequence, exposure, marks.get(exposure))
        finally:
            self.store.put(Bookmarks(bookmarks))
