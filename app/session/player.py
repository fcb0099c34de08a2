"""Shows a run frame by frame, at the chosen speed or towards a target, and computes what is not known yet."""

from __future__ import annotations

import time
from collections.abc import Callable

from ..engine.events import Finished, Stepped
from ..engine.memory import release_library_pages
from . import moves
from .compiling import Compiling
from .current_run import CurrentRun
from .state import Computed, Displayed, Event, NoticeAdded, changed
from .store import Store
from .viewers import Viewers

LIVE_WAIT_S = 0.05
"""For an image of a live source at a time."""


class Player:
    """`run` is the one that is on the screen: another object for each start, None before the first."""

    def __init__(self, store: Store, viewers: Viewers, compiling: Compiling) -> None:
        self.run: CurrentRun | None = None
        self._store, self._viewers, self._compiling = store, viewers, compiling
        self.computed: Callable[[Stepped], None] = lambda event: None
        """Called with each new frame."""
        self._due_s = 0.0
        self._differing_run: CurrentRun | None = None
        """The run whose replay is not what is stored of it."""

    def move(self, *events: Event) -> None:
        """From now on as these events say, without waiting for the frame that was due."""
        self._due_s = 0.0
        self._store.emit(*events)

    def patience_s(self, idle_s: float) -> float:
        """How long nothing is due, at most `idle_s`."""
        state = self._store.state
        if state.target is not None:
            return 0.0
        return min(idle_s, max(0.0, self._due_s - time.monotonic())) if state.playing else idle_s

    def advance(self) -> None:
        """One frame on, where it is time for that."""
        run, state = self.run, self._store.state
        if run is None:
            self._store.set(playing=False, target=None)
        elif run.catching_up and (state.target is not None or (state.playing and state.index + 1 >= state.computed)):
            self._compute(run)
        elif state.target is not None:
            known = len(run.series)
            self._compute(run)
            if len(run.series) > known:
                self._store.emit(*moves.after_step(self._store.state.until, run, state.target))
        elif state.playing and time.monotonic() >= self._due_s:
            if back := moves.around(state, run):
                self._store.emit(*back)
            elif state.index + 1 < len(run.history):
                self._store.emit(Displayed(run.history[state.index + 1]))
            elif run.done:
                self._store.set(playing=False)
            elif self._more(run):
                self._compute(run)
            self._due_s = moves.due_s(self._store.state, run, self._due_s, time.monotonic())

    def _more(self, run: CurrentRun) -> bool:
        """Whether there is a frame to compute; a live source is waited for a while."""
        live = run.live
        found = run.playback.more(LIVE_WAIT_S)
        if live:
            sequence = run.playback.sequence
            self._store.emit(changed(total=len(sequence), notes=sequence.notes))
            if run.playback.done:
                self._finish(run.finish())
        return found

    def _compute(self, run: CurrentRun) -> None:
        if not self._compiling.ready(run.playback):
            return
        if run.catching_up:
            self._store.busy(f"replaying frame {run.playback.position} up to {len(run.history)}")
            if (difference := run.catch_up()) and run is not self._differing_run:
                self._differing_run = run  # reported once: what follows from the first difference differs as well
                self._store.emit(NoticeAdded(difference))
            return
        self._store.busy(f"{run.doing(self._store.state.source)} frame {run.playback.position}")
        event, record = run.step()
        self._store.emit(Computed(record, run.tally, run.history_usage))
        if event.skipped:
            self._store.emit(NoticeAdded(f"frame {event.index} is skipped: {event.skipped}"))
        self._viewers.write(event)
        self.computed(event)
        release_library_pages(run.playback.position)
        if run.playback.done:
            self._finish(run.finish())
        self._store.set(activity=None)

    def _finish(self, finished: Finished) -> None:
        self._viewers.write(finished)
        self._store.emit(finished)
        release_library_pages(1)
