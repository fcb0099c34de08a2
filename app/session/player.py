"""Shows a run frame by frame, at the chosen speed or towards a target, and computes what is not known yet."""

from __future__ import annotations

import time
from collections.abc import Callable

from ..engine.events import Finished, Stepped
from . import moves
from .compiling import Compiling
from .current_run import CurrentRun
from .state import Computed, Displayed, Event, NoticeAdded, changed
from .store import Store
from .viewers import Viewers

LIVE_WAIT_S = 0.05
"""For an image of a live source at a time."""
BEHIND_S = 0.02
"""How often a frame that is computed in another thread is looked for."""
ALONE_S = 30.0
"""Recorded frames are not computed before a viewer shows them move, for a page that opens needs the processor; where
nobody looks, after so long."""


class Player:
    """`run` is the one that is on the screen: another object for each start, None before the first."""

    def __init__(
        self, store: Store, viewers: Viewers, compiling: Compiling, computed: Callable[[Stepped], None]
    ) -> None:
        """`computed` is called with each new frame."""
        self.run: CurrentRun | None = None
        self._store, self._viewers, self._compiling, self._computed = store, viewers, compiling, computed
        self._due_s = 0.0
        self._differing_run: CurrentRun | None = None
        """The run whose replay is not what is stored of it."""
        self._failed_run: CurrentRun | None = None
        """The run that cannot be computed while its recorded frames are shown."""
        self._opened: tuple[CurrentRun | None, float] = (None, 0.0)
        """The run that was shown last, and since when."""

    def move(self, *events: Event) -> None:
        """From now on as these events say, without waiting for the frame that was due."""
        self._due_s = 0.0
        self._store.emit(*events)

    def patience_s(self, idle_s: float) -> float:
        """How long nothing is due, at most `idle_s`."""
        state = self._store.state
        if state.target is not None:
            return 0.0
        if state.recorded:
            idle_s = min(idle_s, BEHIND_S)
        return min(idle_s, max(0.0, self._due_s - time.monotonic())) if state.playing else idle_s

    def advance(self) -> None:
        """One frame on, where it is time for that; of recorded frames, one more is computed meanwhile."""
        run, state = self.run, self._store.state
        if run is None:
            self._store.set(playing=False, target=None)
            return
        self._compute_behind(run)
        state = self._store.state
        if run.catching_up and (state.target is not None or (state.playing and state.index + 1 >= state.computed)):
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
            elif run.recorded_frames:
                self._store.emit(Displayed(run.history[0]))  # rather than stand still until the rest is computed
            elif run.done:
                self._store.set(playing=False)
            elif self._more(run):
                self._compute(run)
            self._due_s = moves.due_s(self._store.state, run, self._due_s, time.monotonic())

    def _compute_behind(self, run: CurrentRun) -> None:
        """Recorded frames are computed in another thread, while they are shown."""
        self._store.set(recorded=run.recorded_frames)
        if run is not self._opened[0]:
            self._opened = run, time.monotonic()
        if not run.recorded_frames or run is self._failed_run:
            return
        waits = not self._viewers.watched and time.monotonic() < self._opened[1] + ALONE_S
        if waits or not self._compiling.over(run.playback):
            return
        if run.begin_step():
            self._failed_run = run  # unless the next line comes to its end: a fault is shown once
            self._replace(run)
            self._failed_run = None

    def _replace(self, run: CurrentRun) -> None:
        """One more of the recorded frames is computed: it takes the place of the recorded one, also on the screen."""
        event, record = run.step()
        self._store.set(recorded=run.recorded_frames, activity=None)
        if record.index == self._store.state.index:
            self._store.emit(Displayed(record))
        self._viewers.write(event)
        self._computed(event)

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
        self._store.busy(f"{run.doing(self._store.state.source)} frame {run.history.computed}")
        if run.recorded_frames:
            self._replace(run)
            return
        event, record = run.step()
        self._store.emit(Computed(record, run.tally, run.history_usage))
        if event.skipped:
            self._store.emit(NoticeAdded(f"frame {event.index} is skipped: {event.skipped}"))
        self._viewers.write(event)
        self._computed(event)
        if run.playback.done:
            self._finish(run.finish())
        self._store.set(activity=None)

    def _finish(self, finished: Finished) -> None:
        self._viewers.write(finished)
        self._store.emit(finished)
