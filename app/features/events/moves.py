"""Moves from event to event: to the nearest one that is known, or on until there is one."""

from __future__ import annotations

from collections.abc import Iterable

from ispom.errors import InputError

from ...engine.run_events.event import RunEvent
from ...engine.run_events.find import nearest, with_bookmarks
from ...presentation import colours
from ...session.current_run import CurrentRun
from ...session.state import Displayed, Event, NoticeAdded, State, changed
from .commands import NextEvent


def to_event(state: State, run: CurrentRun | None, *, forwards: bool, alarming: bool) -> tuple[Event, ...]:
    """Pause, and show the nearest frame with an event, or say that there is none. Forwards, the run goes on until there
    is one.

    InputError where nothing is open.
    """
    if run is None:
        raise InputError("there are no events yet: open a source first")
    known = with_bookmarks(run.events.events, state.bookmarks)
    found = nearest((e for e in known if e.frame < state.computed), state.index, forwards=forwards, alarming=alarming)
    if found:
        shown = changed(playing=False, target=None), Displayed(run.history[found[0].frame])
        return (*shown, told(found)) if alarming else shown  # the list of events says it of the others
    if forwards and state.computed <= run.last:
        return (changed(playing=False, target=run.last, until=NextEvent(alarming)),)
    return (NoticeAdded(none_left(known, state.index, forwards=forwards, alarming=alarming), "info"),)


def after_step(state: State, run: CurrentRun, wanted: NextEvent) -> tuple[Event, ...]:
    """What the newest frame means for a run that goes on towards an event; nothing where it has none."""
    frame = len(run.series) - 1
    found = nearest(run.events.events, frame - 1, forwards=True, alarming=wanted.alarming)
    return (changed(target=None), told(found)) if found else ()


def told(events: Iterable[RunEvent]) -> NoticeAdded:
    """What happened at the frame that is shown, in words."""
    found = list(events)
    said = " ".join(f"{colours.label(e.method)}: {e.sentence}" if e.method else e.sentence for e in found)
    return NoticeAdded(f"Frame {found[0].frame} · {said}", "info")


def none_left(known: Iterable[RunEvent], frame: int, *, forwards: bool, alarming: bool) -> str:
    """A sentence that says so, and how many lie the other way."""
    what, where = ("anomaly" if alarming else "event"), "after" if forwards else "before"
    others = sum(
        (e.frame < frame) == forwards and e.frame != frame for e in known if e.severity.alarming or not alarming
    )
    hint = f" There are {others} {'earlier' if forwards else 'later'} ones." if others > 1 else ""
    return f"No {what} {where} frame {max(frame, 0)}.{hint}"
