"""What moving through a run means, as events: the run's history on the one hand, a target to compute towards on the
other."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from ispom.errors import InputError

from ..engine.conditions.matches import first_match
from ..engine.conditions.parser import Expression, parse
from .current_run import CurrentRun
from .state import Displayed, Event, Loop, State, changed


def play(state: State, run: CurrentRun | None, on: bool | None) -> tuple[Event, ...]:
    """Play, pause, or (None) whichever it is not doing. At the end, playing starts over, or at the loop's start."""
    playing = run is not None and (not state.playing if on is None else on)
    events: list[Event] = [changed(playing=playing, target=None)]
    if playing and run is not None and run.done and state.index >= state.total - 1 and run.history:
        events.insert(0, Displayed(run.history[state.loop.start if state.loop is not None else 0]))
    return tuple(events)


def seek(run: CurrentRun | None, index: int) -> tuple[Event, ...]:
    """Pause, and show this exposure, or the nearest that the source has; beyond the history it becomes the target."""
    if run is None:
        return ()
    index = min(max(index, 0), run.last)
    if index < len(run.history):
        return Displayed(run.history[index]), changed(playing=False, target=None)
    return (changed(playing=False, target=index),)


def step(state: State, run: CurrentRun | None, count: int) -> tuple[Event, ...]:
    """Pause, and move by so many exposures, counted from where an earlier move is still going to."""
    return seek(run, (state.index if state.target is None else state.target) + count)


def step_to(
    state: State, run: CurrentRun | None, kind: Literal["stereo", "key_frame"], *, forwards: bool
) -> tuple[Event, ...]:
    """Pause, and show the nearest exposure of a kind; InputError where there is none in this direction."""
    if run is None:
        return ()
    if kind == "stereo":
        return _to_stereo(state, run, forwards)
    expression = key_frame(run)
    among = range(state.index + 1, state.computed) if forwards else range(state.index - 1, -1, -1)
    index = first_match(expression, run.series, among)
    if index is not None:
        return seek(run, index)
    last = run.last
    if not forwards or state.computed > last:
        raise InputError(f"there is no key frame {'after' if forwards else 'before'} exposure {max(state.index, 0)}")
    return (changed(playing=False, target=last, until=expression),)


def key_frame(run: CurrentRun) -> Expression:
    """The condition that any of the running methods made a key frame."""
    return parse(" or ".join(f"{method}.key_frame" for method in run.opened.methods), run.series.quantities)


def _to_stereo(state: State, run: CurrentRun, forwards: bool) -> tuple[Event, ...]:
    """Counted from where an earlier move is still going to."""
    kinds, at = run.playback.sequence.kinds, state.index if state.target is None else state.target
    among = range(at + 1, len(kinds)) if forwards else range(at - 1, -1, -1)
    index = next((i for i in among if kinds[i] == "stereo"), None)
    if index is None:
        raise InputError(f"there is no stereo exposure {'after' if forwards else 'before'} exposure {max(at, 0)}")
    return seek(run, index)


def to_end(run: CurrentRun | None) -> tuple[Event, ...]:
    """Pause, and show the newest computed exposure."""
    return seek(run, len(run.history) - 1) if run is not None and run.history else ()


def loop_edge(state: State, edge: Literal["start", "end"]) -> tuple[Event, ...]:
    """The exposure that is shown becomes an edge of the loop; InputError where no exposure would be left in it."""
    loop, at = state.loop or Loop(), max(state.index, 0)
    last = state.total - 1
    # An edge on the wrong side of the other one begins another loop.
    if edge == "start":
        loop = Loop(at, loop.end if loop.end is not None and loop.end > at else None)
    else:
        loop = replace(loop, start=loop.start if loop.start < at else 0, end=at)
    if loop.start >= (last if loop.end is None else loop.end):
        raise InputError(f"a loop needs two exposures: exposure {at} cannot be its {edge}")
    return (changed(loop=loop),)


def around(state: State, run: CurrentRun) -> tuple[Event, ...]:
    """Back to the start of the loop, where playing came to its end."""
    if state.loop is None or len(run.history) <= state.loop.start:
        return ()
    done = run.done and state.index >= len(run.history) - 1
    past = state.loop.end is not None and state.index >= state.loop.end
    return (Displayed(run.history[state.loop.start]),) if done or past else ()


def due_s(state: State, run: CurrentRun, before_s: float, now_s: float) -> float:
    """When the exposure after the one that is shown is due, at the chosen speed; `before_s` was when that one was.

    Time that was lost is not caught up.
    """
    times, i = run.playback.sequence.times_ns, state.index
    if state.speed is None or not 0 <= i < len(times) - 1:
        # As fast as possible: as fast as new exposures are computed, and the past no faster than eyes follow.
        return now_s + (1 / 120 if i + 1 < len(run.history) else 0.0)
    return max(now_s, before_s + float(times[i + 1] - times[i]) * 1e-9 / state.speed)
