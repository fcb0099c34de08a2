"""Choosing what is plotted."""

from __future__ import annotations

from ...session.commands import PageCommand
from ...session.controller import Controller
from ...session.registry import handles
from .plotting import chosen, toggled
from .state import Plots


class Plot(PageCommand, frozen=True):
    """Plot a quantity over the frames, or stop plotting it."""

    name: str
    """METHOD.KEY, or the KEY of Steps for all methods."""


class SetPlots(PageCommand, frozen=True):
    """Plot just these quantities; None for the usual ones."""

    names: tuple[str, ...] | None


@handles(Plot)
def plot(session: Controller, command: Plot) -> None:
    session.store.put(Plots(toggled(session.state[Plots].names, session.run, command.name)))


@handles(SetPlots)
def set_plots(session: Controller, command: SetPlots) -> None:
    session.store.put(Plots(chosen(session.run, command.names)))
