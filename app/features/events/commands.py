"""Moving from event to event: to the nearest one that is known, or on until there is one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ispom.errors import InputError

from ...engine.run_events.event import RunEvent, nearest, with_bookmarks
from ...presentation import colours
from ...session.actions import Action, offer
from ...session.commands import PageCommand
from ...session.controller import Controller
from ...session.current_run import CurrentRun
from ...session.goals import Goal
from ...session.state import Displayed, Event, NoticeAdded, State, changed
from ..bookmarks.service import Bookmarks


@dataclass(frozen=True)
class NextEvent(Goal):
    """A run goes on towards the next event."""

    alarming: bool = False
    """Warnings and losses only."""

    def reached(self, run: CurrentRun) -> str | None:
        frame = len(run.series) - 1
        found = nearest(run.events.events, frame - 1, forwards=True, alarming=self.alarming)
        return event_sentences(found) if found else None

    def missed(self, run: CurrentRun) -> str:
        return none_left(run.events.events, len(run.series), forwards=True, alarming=self.alarming)


def to_event(state: State, run: CurrentRun | None, *, forwards: bool, alarming: bool) -> tuple[Event, ...]:
    """Pause, and show the nearest frame with an event, or say that there is none. Forwards, the run goes on until there
    is one.

    InputError if nothing is open.
    """
    if run is None:
        raise InputError("there are no events yet: open a source first")
    known = with_bookmarks(run.events.events, state[Bookmarks].marks)
    found = nearest((e for e in known if e.frame < state.computed), state.index, forwards=forwards, alarming=alarming)
    if found:
        shown = changed(playing=False, target=None), Displayed(run.history[found[0].frame])
        # The list of events shows the sentences of the others.
        return (*shown, NoticeAdded(event_sentences(found), "info")) if alarming else shown
    if forwards and state.computed <= run.last:
        return (changed(playing=False, target=run.last, until=NextEvent(alarming)),)
    return (NoticeAdded(none_left(known, state.index, forwards=forwards, alarming=alarming), "info"),)


def event_sentences(events: Iterable[RunEvent]) -> str:
    """Returns the events of one frame as sentences."""
    found = list(events)
    sentences = " ".join(f"{colours.label(e.method)}: {e.sentence}" if e.method else e.sentence for e in found)
    return f"Frame {found[0].frame} · {sentences}"


def none_left(known: Iterable[RunEvent], frame: int, *, forwards: bool, alarming: bool) -> str:
    """A sentence that says so, and how many lie the other way."""
    what, where = ("problem" if alarming else "event"), "after" if forwards else "before"
    others = sum(
        (e.frame < frame) == forwards and e.frame != frame for e in known if e.severity.alarming or not alarming
    )
    hint = f" There are {others} {'earlier' if forwards else 'later'} ones." if others > 1 else ""
    return f"No {what} {where} frame {max(frame, 0)}.{hint}"


class StepToEvent(PageCommand, frozen=True):
    """Pause, and show the nearest frame with an event. Forwards, frames are computed until there is one."""

    forwards: bool = True
    alarming: bool = False
    """Warnings and losses only."""

    def execute(self, session: Controller) -> None:
        moved = to_event(session.state, session.run, forwards=self.forwards, alarming=self.alarming)
        session.player.move(*moved)


what = "to a frame with an event, such as a loss or a warning."
offer(Action(80, "event", "n", "Next event", f"On {what}", StepToEvent()))
offer(Action(90, "event_back", "Shift+n", "Previous event", f"Back {what}", StepToEvent(forwards=False)))
