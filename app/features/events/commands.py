"""Moving from event to event."""

from __future__ import annotations

from ...session.actions import Action, offer
from ...session.commands import PageCommand
from ...session.controller import Controller
from ...session.registry import handles
from .moves import to_event


class StepToEvent(PageCommand, frozen=True):
    """Pause, and show the nearest frame with an event. Forwards, frames are computed until there is one."""

    forwards: bool = True
    alarming: bool = False
    """Warnings and losses only."""


what = "to a frame with an event, such as a loss or a warning."
offer(Action(80, "event", "n", "Next event", f"On {what}", StepToEvent()))
offer(Action(90, "event_back", "Shift+n", "Previous event", f"Back {what}", StepToEvent(forwards=False)))


@handles(StepToEvent)
def step_to_event(session: Controller, command: StepToEvent) -> None:
    moved = to_event(session.state, session.run, forwards=command.forwards, alarming=command.alarming)
    session.player.move(*moved)
