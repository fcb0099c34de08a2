"""What moving through a run means, as events: the run's history on the one hand, a target to compute towards on the
other."""

from __future__ import annotations

from .current_run import CurrentRun
from .state import Displayed, Event, State, changed


def play(state: State, run: CurrentRun | None, on: bool | None) -> tuple[Event, ...]:
    """Play, pause, or (None) whichever it is not doing. At the end, playing starts over from the history."""
    playing = run is not None and (not state.playing if on is None else on)
    events: list[Event] = [changed(playing=playing, target=None)]
    if playing and run is not None and run.playback.done and state.index >= state.total - 1 and run.history:
        events.insert(0, Displayed(run.history[0]))
    return tuple(events)


def seek(run: CurrentRun | None, index: int) -> tuple[Event, ...]:
    """Pause, and show this exposure, or the nearest that the source has; beyond the history it becomes the target."""
    if run is None:
        return ()
    index = min(max(index, 0), len(run.playback.sequence) - 1)
    if index < len(run.history):
        return Displayed(run.history[index]), changed(playing=False, target=None)
    return (changed(playing=False, target=index),)


def step(state: State, run: CurrentRun | None, count: int) -> tuple[Event, ...]:
    """Pause, and move by so many exposures, counted from where an earlier move is still going to."""
    return seek(run, (state.index if state.target is None else state.target) + count)


def due_s(state: State, run: CurrentRun, before_s: float, now_s: float) -> float:
    """When the exposure after the one that is shown is due, at the chosen speed; `before_s` was when that one was.

    Time that was lost is not caught up.
    """
    times, i = run.playback.sequence.times_ns, state.index
    if state.speed is None or not 0 <= i < len(times) - 1:
        # As fast as possible: as fast as new exposures are computed, and the past no faster than eyes follow.
        return now_s + (1 / 120 if i + 1 < len(run.history) else 0.0)
    return max(now_s, before_s + float(times[i + 1] - times[i]) * 1e-9 / state.speed)
