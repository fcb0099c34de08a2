"""Moves through a run, as events. A move shows a frame of the history, or sets a target up to which frames are
computed."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from ispom.errors import InputError

from ..engine.conditions.evaluate import first_match
from ..engine.conditions.parser import Expression, parse
from .current_run import CurrentRun
from .goals import Goal, Holds
from .state import Displayed, Event, Loop, NoticeAdded, State, changed


def play(state: State, run: CurrentRun | None, on: bool | None) -> tuple[Event, ...]:
    """Plays, pauses, or (None) changes between the two. At the end, playing starts again at the first frame, or at the
    start of the loop."""
    playing = run is not None and (not state.playing if on is None else on)
    events: list[Event] = [changed(playing=playing, target=None)]
    if playing and run is not None and run.done and state.index >= state.total - 1 and run.history:
        events.insert(0, Displayed(run.history[state.loop.start if state.loop is not None else 0]))
    return tuple(events)


def seek(run: CurrentRun | None, index: int) -> tuple[Event, ...]:
    """Pause, and show this frame, or the nearest that the source has; beyond the history it becomes the target."""
    if run is None:
        return ()
    index = min(max(index, 0), run.last)
    if index < len(run.history):
        return Displayed(run.history[index]), changed(playing=False, target=None)
    return (changed(playing=False, target=index),)


def step(state: State, run: CurrentRun | None, count: int) -> tuple[Event, ...]:
    """Pauses and moves by this number of frames, counted from the target of an earlier move that is not reached yet."""
    return seek(run, (state.index if state.target is None else state.target) + count)


def step_to(
    state: State, run: CurrentRun | None, kind: Literal["stereo", "key_frame"], *, forwards: bool
) -> tuple[Event, ...]:
    """Pause, and show the nearest frame of a kind, or say that there is none in this direction."""
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
        return _none("keyframe", forwards, state.index)
    return (changed(playing=False, target=last, until=Holds(expression)),)


def after_step(goal: Goal | None, run: CurrentRun, target: int) -> tuple[Event, ...]:
    """Returns the events after a new frame: those of a reached goal or target, or none."""
    reached = goal.reached(run) if goal is not None else None
    if reached is not None:
        return changed(target=None), *([NoticeAdded(reached, "info")] if reached else [])
    if len(run.series) - 1 < target:
        return ()
    missed = goal.missed(run) if goal is not None else ""
    return changed(target=None), *([NoticeAdded(missed, "info")] if missed else [])


def key_frame(run: CurrentRun) -> Expression:
    """The condition that any of the running methods made a keyframe."""
    return parse(" or ".join(f"{method}.key_frame" for method in run.opened.methods), run.series.quantities)


def _to_stereo(state: State, run: CurrentRun, forwards: bool) -> tuple[Event, ...]:
    """Shows the nearest stereo frame, counted from the target of an earlier move that is not reached yet."""
    kinds, at = run.playback.sequence.kinds, state.index if state.target is None else state.target
    among = range(at + 1, len(kinds)) if forwards else range(at - 1, -1, -1)
    index = next((i for i in among if kinds[i] == "stereo"), None)
    if index is None:
        return _none("stereo frame", forwards, at)
    return seek(run, index)


def _none(what: str, forwards: bool, index: int) -> tuple[Event, ...]:
    text = f"There is no {what} {'after' if forwards else 'before'} frame {max(index, 0)}."
    return changed(playing=False, target=None), NoticeAdded(text, "info")


def to_end(run: CurrentRun | None) -> tuple[Event, ...]:
    """Pause, and show the newest computed frame."""
    return seek(run, len(run.history) - 1) if run is not None and run.history else ()


def loop_edge(state: State, edge: Literal["start", "end"]) -> tuple[Event, ...]:
    """The frame that is shown becomes an edge of the loop; InputError where no frame would be left in it."""
    loop, at = state.loop or Loop(), max(state.index, 0)
    last = state.total - 1
    # An edge on the wrong side of the other one begins another loop.
    if edge == "start":
        loop = Loop(at, loop.end if loop.end is not None and loop.end > at else None)
    else:
        loop = replace(loop, start=loop.start if loop.start < at else 0, end=at)
    if loop.start >= (last if loop.end is None else loop.end):
        raise InputError(f"a loop needs two frames: frame {at} cannot be its {edge}")
    return (changed(loop=loop),)


def set_loop(state: State, start: int, end: int | None) -> tuple[Event, ...]:
    """Makes playing repeat these frames; `end` None is the last one. InputError for fewer than two frames."""
    last = state.total - 1
    loop = Loop(max(start, 0), None if end is None else min(end, last))
    if loop.start >= (last if loop.end is None else loop.end):
        raise InputError(f"a loop needs two frames: it cannot go from frame {start} to {last if end is None else end}")
    return (changed(loop=loop),)


def around(state: State, run: CurrentRun) -> tuple[Event, ...]:
    """Shows the start of the loop again if playing has reached its end."""
    if state.loop is None or len(run.history) <= state.loop.start:
        return ()
    done = run.done and state.index >= len(run.history) - 1
    past = state.loop.end is not None and state.index >= state.loop.end
    return (Displayed(run.history[state.loop.start]),) if done or past else ()


def due_s(state: State, run: CurrentRun, before_s: float, now_s: float) -> float:
    """Returns the time at which the next frame is due at the chosen speed; `before_s` is that of the frame shown.

    Lost time is not made up.
    """
    times, i = run.playback.sequence.times_ns, state.index
    if state.speed is None or not 0 <= i < len(times) - 1:
        # As fast as possible: new frames as fast as they are computed, past frames no faster than eyes can follow.
        return now_s + (1 / 120 if i + 1 < len(run.history) or run.recorded_frames else 0.0)
    return max(now_s, before_s + float(times[i + 1] - times[i]) * 1e-9 / state.speed)
