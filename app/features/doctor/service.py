"""Runs one examination at a time in a thread of its own, so that the page stays usable meanwhile."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from threading import Event, Thread

from ispom.errors import InputError
from ispom.evaluation.doctor.diagnosis import Diagnosis

from ...engine import warmup
from ...engine.playback import Playback
from ...engine.run_events.stretch import Stretch, stretch_of
from ...session import moves
from ...session.branches.service import BranchService
from ...session.branches.state import Branches
from ...session.controller import Controller
from ...session.current_run import CurrentRun
from ...session.service import Service
from .job import Progress, examine
from .options import FRAMES, SECONDS
from .origin import Origin
from .rerun import config_of
from .state import Examined

CANCELLED = "cancelled"
THOROUGH_S = 180.0
"""For an examination that also tries the settings for which the first one had no time left."""
COMPILER_S = 0.1
"""For the compiler at a time, before its progress is shown again."""


class _Cancelled(Exception):
    """Ends the thread's work."""


@dataclass(eq=False)
class _Work:
    """What the worker's thread and the examination's share. The fields are only ever replaced."""

    limit_s: float
    """Seconds after which no new suspect is examined."""
    stop: Event = field(default_factory=Event)
    progress: Progress | None = None
    diagnosis: Diagnosis | None = None
    problem: str = ""
    thread: Thread | None = None
    began_s: float | None = None
    """By time.monotonic; None while the compiler works."""

    @property
    def taken_s(self) -> int:
        return 0 if self.began_s is None else int(time.monotonic() - self.began_s)

    def run(self, playback: Playback, stretch: Stretch, origin: Origin) -> None:
        sequence, methods, config = playback.sequence, playback.methods, playback.config
        try:
            while not warmup.ready(methods, config, COMPILER_S):  # before its time begins to count
                count = stretch.last - stretch.first + 1
                self.report(Progress(0, count, warmup.message(methods, config)))
            self.began_s = time.monotonic()
            self.diagnosis = examine(sequence, stretch, self.limit_s, self.report, origin=origin)
        except _Cancelled:
            self.problem = CANCELLED
        except InputError as fault:
            self.problem = str(fault)
        except Exception as fault:  # a thread has nobody to raise to; the page says it
            self.problem = f"the examination failed ({type(fault).__name__}: {fault})"

    def report(self, progress: Progress) -> None:
        self.progress = progress
        if self.stop.is_set():
            raise _Cancelled


class DoctorService(Service):
    """Examines the run that is shown."""

    place = 70

    def __init__(self, session: Controller) -> None:
        super().__init__(session)
        self._work: _Work | None = None
        self._examined: CurrentRun | None = None

    @property
    def busy(self) -> bool:
        return self._work is not None

    def start(self, at: int | None, *, thorough: bool = False) -> None:
        """Begins an examination; a thorough one has more time. InputError where there is no run, its source is gone or
        live, or one goes on."""
        run = self.run
        if run is None:
            raise InputError("there is no run yet: open a source first")
        if run.live:
            raise InputError("a live source is still recording: wait for its end")
        if self._work is not None:
            raise InputError("an examination goes on already: cancel it first")
        run.require_source()
        sequence = run.playback.sequence
        frame = max(self.state.index, 0) if at is None else at
        stretch = stretch_of(sequence, frame, FRAMES, run.events.events)
        work, self._examined = _Work(THOROUGH_S if thorough else SECONDS), run
        self._work = work
        origin = Origin.of_run(run, stretch)
        work.thread = Thread(target=work.run, args=(run.playback, stretch, origin), name="doctor", daemon=True)
        work.thread.start()
        progress = Progress(0, stretch.last - stretch.first + 1, "reading images")
        self.store.put(Examined(stretch, progress, branch=self.state[Branches].shown, limit_s=round(work.limit_s)))

    def fork_with_remedy(self) -> None:
        """Forks the run before the stretch, with the setting that helped. InputError where none did, or another run is
        shown."""
        run, found = self.run, self.state[Examined].diagnosis
        reruns = None if found is None else found.helped
        if run is None or run is not self._examined or reruns is None or reruns.best is None:
            raise InputError("no setting helped the run that is shown: diagnose it first")
        config = config_of(reruns.best.trial, run.playback.config)
        self.session.player.move(*moves.seek(run, max(reruns.first - 1, 0)))
        name = reruns.best.trial.option.removeprefix("--")
        self.session.service(BranchService).fork(self.state.methods, config, name)

    def cancel(self) -> None:
        """Ends the examination between two pieces of its work; nothing happens where there is none."""
        if self._work is not None:
            self._work.stop.set()

    def leave(self, run: CurrentRun | None) -> None:
        self.cancel()

    def watch(self) -> None:
        """Takes over how far the examination is."""
        work, shown = self._work, self.state[Examined]
        if work is None or work.thread is None:
            return
        if work.thread.is_alive():
            now = replace(shown, progress=work.progress or shown.progress, taken_s=work.taken_s)
            if (now.progress, now.taken_s) != (shown.progress, shown.taken_s):
                self.store.put(now)
            return
        self._work = None
        self.store.put(replace(shown, progress=None, diagnosis=work.diagnosis, problem=work.problem))

    def close(self) -> None:
        work = self._work
        if work is not None and work.thread is not None:
            work.stop.set()
            work.thread.join(PATIENCE_S)


PATIENCE_S = 2.0
"""How long a cancelled examination is waited for at the end of the session; its thread ends with the process."""
