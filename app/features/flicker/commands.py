"""Drawing one of two sides at a time."""

from __future__ import annotations

from ...session.actions import Action, offer
from ...session.commands import Command, PageCommand
from ...session.controller import Controller
from ...session.registry import handles
from ..branches.service import BranchService
from ..branches.state import Branches
from . import flicker
from .flicker import Side
from .state import Flickering


class FlickerBetween(Command, frozen=True):
    """Draw one of two sides at a time, the first of them now."""

    a: Side
    b: Side


class Flick(PageCommand, frozen=True):
    """Draw the other side of the flicker; without one, begin it between the usual two."""


class StopFlicker(Command, frozen=True):
    """Draw all as usual."""


offer(Action(160, "flick", "x", "Flicker", "Draws the other of two methods or branches, see Flicker.", Flick()))


@handles(FlickerBetween)
def flicker_between(session: Controller, command: FlickerBetween) -> None:
    sides = session.service(BranchService).sides
    session.store.put(Flickering(flicker.between(sides, command.a, command.b)))


@handles(Flick)
def flick(session: Controller, command: Flick) -> None:
    now = session.state[Flickering].between
    if now is None:
        now = flicker.usual(session.service(BranchService).sides, session.state[Branches].shown)
    else:
        now = now.turned
    session.store.put(Flickering(now))


@handles(StopFlicker)
def stop_flicker(session: Controller, command: StopFlicker) -> None:
    session.store.put(Flickering())
