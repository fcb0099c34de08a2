"""Choosing what the stage draws."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from ispom.methods import names

from ...engine.inspection.colouring import Colouring
from ...session.commands import Command, PageCommand
from ...session.controller import Controller
from ...session.current_run import CurrentRun
from ...session.state import Event, FeatureChanged, State
from ...views.rerun.layers import LAYERS, OPTIONAL
from .state import Layers


class Hide(PageCommand, frozen=True):
    """Draw all but these layers and methods."""

    names: frozenset[str]
    only_looks: ClassVar[bool] = True

    def look(self, state: State, run: CurrentRun) -> tuple[Event, ...]:
        return (FeatureChanged(self._after(state)),)

    def execute(self, session: Controller) -> None:
        session.store.put(self._after(session.state))

    def _after(self, state: State) -> Layers:
        return replace(state[Layers], hidden=known(self.names))


class Choose(PageCommand, frozen=True):
    """Draw these optional layers."""

    names: frozenset[str]

    def execute(self, session: Controller) -> None:
        session.store.put(replace(session.state[Layers], chosen=self.names & OPTIONAL))


class ColourBy(Command, frozen=True):
    """What the colours of tracks mean, in all images."""

    colouring: Colouring

    def execute(self, session: Controller) -> None:
        session.store.put(replace(session.state[Layers], colour_by=self.colouring))


def known(found: frozenset[str]) -> frozenset[str]:
    """Those of the names that are methods or layers which are drawn unless they are hidden."""
    return found & {*LAYERS, *names()} - OPTIONAL
