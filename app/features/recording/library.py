"""The recordings of a session: the one that is being made, and the list of those that are there."""

from __future__ import annotations

from ispom.errors import InputError

from ...session.current_run import CurrentRun
from ...session.state import NoticeAdded
from ...session.store import Store
from ..bookmarks.notes import notes_of, put
from .listing import list_recordings
from .repairs import Repairs
from .service import RecordingDesk

CLOSE_S = 1.0
"""For a recording to be closed at the end."""


class Shelf:
    """Used in the worker's thread alone."""

    def __init__(self, store: Store, desk: RecordingDesk) -> None:
        self._store, self._desk, self._repairs = store, desk, Repairs(desk.folder)

    @property
    def busy(self) -> bool:
        """Whether something is being written or repaired."""
        return self._desk.busy or self._repairs.busy

    def record(self, name: str, run: CurrentRun | None) -> None:
        """InputError where there is nothing to record, or not under this name."""
        if run is None:
            raise InputError("there is nothing to record yet: open a source first")
        if run.stored is not None:
            raise InputError("a run that is over is not recorded: fork it, and record the branch")
        self._desk.start(name, run)
        self._store.set(recording=self._desk.info())

    def stop(self, run: CurrentRun | None) -> None:
        """The file is closed when all of the run so far is written, which may take a while."""
        if self._desk.recording and run is not None:
            self._desk.stop(run.finish() if run.history else None, self._store.state.bookmarks)

    def watch(self) -> None:
        """Shows how a recording goes, and what became of it."""
        ended = self._desk.ended()
        self._store.set(recording=self._desk.info())
        for writer in ended:
            if writer.failure:
                self._store.emit(NoticeAdded(f"recording {writer.path.name} stopped: {writer.failure}"))
        problems = self._repairs.ended()
        for problem in problems or ():
            self._store.emit(NoticeAdded(problem))
        if ended or problems is not None:
            self.show()

    def put_note(self, name: str, note: str) -> None:
        """Of a run or recording in the list."""
        if name not in [kept.name for kept in self._store.state.recordings]:
            raise InputError(f"there is no run or recording {name[:60]!r} in the list: choose one of it")
        put(notes_of(self._desk.folder / name), note=note)
        self.show()

    def repair(self) -> None:
        """Makes what was never finished readable, beside all else."""
        self._repairs.start()

    def show(self) -> None:
        """The list, as the folder is now."""
        self._store.set(recordings=list_recordings(self._desk.folder), unfinished=self._repairs.found())

    def close(self) -> None:
        self._desk.close(CLOSE_S)
