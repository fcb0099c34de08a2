"""The recordings of a session: the one that is being made, and the list of those that are there."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from threading import Thread

from ispom.errors import InputError

from ...engine.events import Stepped
from ...session.branches.state import Branches
from ...session.controller import Controller
from ...session.current_run import CurrentRun
from ...session.service import Service
from ...session.state import NoticeAdded
from ...views.rerun.repair import finish
from ..bookmarks.notes import notes_of, put
from ..bookmarks.service import Bookmarks
from ..layers.state import Layers
from .listing import list_recordings, list_unfinished
from .repair_command import repair_run
from .state import Recordings
from .writers import Writers

log = logging.getLogger(__name__)


class Repairs:
    """Of one folder. Used by one thread; the work is done in another."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._thread: Thread | None = None
        self._problems: list[str] = []

    @property
    def busy(self) -> bool:
        return self._thread is not None

    def start(self) -> None:
        """Begins to repair all of them; nothing where that goes on already."""
        if self._thread is None:
            self._problems = []
            self._thread = Thread(target=self._run, name="repair", daemon=True)
            self._thread.start()

    def ended(self) -> list[str] | None:
        """Once, when it is over: what could not be repaired, a sentence each."""
        if self._thread is None or self._thread.is_alive():
            return None
        self._thread = None
        return self._problems

    def _run(self) -> None:
        try:
            for path in list_unfinished(self._folder):
                try:
                    self._problems += _finished(path)
                except InputError as problem:
                    self._problems.append(str(problem))
        except Exception as fault:
            log.exception("repairing recordings failed")
            self._problems.append(f"internal fault, please report it: {type(fault).__name__}: {fault}")


def _finished(path: Path) -> list[str]:
    """Finishes a recording or the folder of a run, and returns what could not be: a sentence each."""
    if not path.is_dir():
        finish(path)
        return []
    try:
        return repair_run(path)[1]
    except OSError as error:
        return [f"{path} cannot be repaired ({error.strerror}): see to its permissions"]


CLOSE_S = 1.0
"""For a recording to be closed at the end."""


class RecordingService(Service):
    """The recording that is being made, and the list of those that are there."""

    place = 50

    def __init__(self, session: Controller) -> None:
        super().__init__(session)
        self._writers, self._repairs = (
            Writers(session.setup.recordings, self._has_depth),
            Repairs(session.setup.recordings),
        )
        self.recorded: set[int] = set()
        """Branches of the run on the screen that are, or were, recorded."""

    @property
    def busy(self) -> bool:
        """Whether something is being written or repaired."""
        return self._writers.busy or self._repairs.busy

    def begin(self) -> None:
        self.show()

    def opened(self, run: CurrentRun) -> None:
        self.recorded = set()

    @property
    def kept_branches(self) -> frozenset[int]:
        return frozenset(self.recorded)

    def computed(self, event: Stepped) -> None:
        self._writers.offer(event)

    def record(self, name: str) -> None:
        """InputError if there is nothing to record, or not under this name."""
        run = self.run
        if run is None:
            raise InputError("there is nothing to record yet: open a source first")
        if run.stored is not None:
            raise InputError("a run that is over is not recorded: fork it, and record the branch")
        self._writers.start(name, run)
        self.recorded.add(self.state[Branches].shown)
        self._show_current()

    def leave(self, run: CurrentRun | None) -> None:
        """The file is closed when all of the run so far is written, which may take a while."""
        if self._writers.recording and run is not None:
            self._writers.stop(run.finish() if run.history else None, self.state[Bookmarks].marks)

    def watch(self) -> None:
        """Shows how a recording goes, and what became of it."""
        ended = self._writers.ended()
        self._show_current()
        for writer in ended:
            if writer.failure:
                self.store.emit(NoticeAdded(f"recording {writer.path.name} stopped: {writer.failure}"))
        problems = self._repairs.ended()
        for problem in problems or ():
            self.store.emit(NoticeAdded(problem))
        if ended or problems is not None:
            self.show()

    def put_note(self, name: str, note: str) -> None:
        """Of a run or recording in the folder."""
        self.show()  # another process may have finished one
        if name not in [kept.name for kept in self.state[Recordings].listed]:
            raise InputError(f"there is no run or recording {name[:60]!r} in the list: choose one of it")
        put(notes_of(self.session.setup.recordings / name), note=note)
        self.show()

    def repair(self) -> None:
        """Makes unfinished recordings and runs readable, in a thread of its own."""
        self._repairs.start()

    def show(self) -> None:
        """The list, as the folder is now."""
        listed = list_recordings(self.session.setup.recordings)
        self.store.put(replace(self.state[Recordings], listed=listed))

    def close(self) -> None:
        self._writers.close(CLOSE_S)

    def close_now(self) -> None:
        """Closes the recordings while the worker is busy, from another thread, within about CLOSE_S."""
        if self._writers.busy:
            finished = self.run.finished_within(0.4 * CLOSE_S) if self.run is not None else None
            self._writers.stop(finished, self.state[Bookmarks].marks)
            self._writers.close(0.6 * CLOSE_S)
            if (current := self.state[Recordings].current) is not None:
                log.warning("The worker was still busy: %s ends with what was written so far.", current.name)

    def _has_depth(self) -> bool:
        return "depth" in self.state[Layers].chosen

    def _show_current(self) -> None:
        self.store.put(replace(self.state[Recordings], current=self._writers.info()))
