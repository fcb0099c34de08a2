"""Shows a run frame by frame, at the chosen speed or up to a target, and computes frames that are missing."""

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
"""Longest wait for the next image of a live source."""
BEHIND_S = 0.02
"""Interval at which a frame that another thread computes is looked for."""
ALONE_S = 30.0
"""Time after which recorded frames are computed if nobody looks at them. Otherwise they are computed once a viewer
plays them, because a page that opens needs the processor."""


class Player:
    """Plays `run`, the run on the screen: another object for each start, None before the first."""

    def __init__(
        self, store: Store, viewers: Viewers, compiling: Compiling, computed: Callable[[Stepped], None]
    ) -> None:
        """`computed` is called with each new frame."""
        self.run: CurrentRun | None = None
        self._store, self._viewers, self._compiling, self._computed = store, viewers, compiling, computed
        self._due_s = 0.0
        self._differing_run: CurrentRun | None = None
        """The run whose replay differs from its stored results; it was reported."""
        self._failed_run: CurrentRun | None = None
        """The run that failed while its recorded frames were shown; it is not computed again."""
        self._opened: tuple[CurrentRun | None, float] = (None, 0.0)
        """The run that was shown last, and the time from which on it is shown."""

    def move(self, *events: Event) -> None:
        """Applies the events of a move at once, without waiting for the frame that was due."""
        self._due_s = 0.0
        self._store.emit(*events)

    def patience_s(self, idle_s: float) -> float:
        """Returns the time until something is due, at most `idle_s`."""
        state = self._store.state
        if state.target is not None:
            return 0.0
        if state.recorded:
            idle_s = min(idle_s, BEHIND_S)
        return min(idle_s, max(0.0, self._due_s - time.monotonic())) if state.playing else idle_s

    def advance(self) -> None:
        """Shows or computes the next frame if it is due. Of a run with recorded frames, one of these is computed
        meanwhile."""
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
        """Computes recorded frames in another thread while they are shown."""
        self._store.set(recorded=run.recorded_frames)
        if run is not self._opened[0]:
            self._opened = run, time.monotonic()
        if not run.recorded_frames or run is self._failed_run:
            return
        waits = not self._viewers.watched and time.monotonic() < self._opened[1] + ALONE_S
        if waits or not self._compiling.over(run.playback):
            return
        if run.begin_step():
            self._failed_run = run  # reset below; if the next line raises, the fault is shown only once
            self._replace(run)
            self._failed_run = None

    def _replace(self, run: CurrentRun) -> None:
        """Replaces a recorded frame by the computed one, also on the screen."""
        event, record = run.step()
        self._store.set(recorded=run.recorded_frames, activity=None)
        if record.index == self._store.state.index:
            self._store.emit(Displayed(record))
        self._viewers.write(event)
        self._computed(event)

    def _more(self, run: CurrentRun) -> bool:
        """Returns whether there is a frame to compute; for a live source it waits up to LIVE_WAIT_S."""
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
                self._differing_run = run  # reported once: after the first difference, later results differ, too
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
