"""Choosing what the stage draws."""

from __future__ import annotations

from dataclasses import replace

from ispom.methods import names

from ...engine.inspection.colouring import Colouring
from ...session.commands import Command, PageCommand
from ...session.controller import Controller
from ...views.rerun.layers import LAYERS, OPTIONAL
from .state import Layers


class Hide(PageCommand, frozen=True):
    """Draw all but these layers and methods."""

    names: frozenset[str]

    def execute(self, session: Controller) -> None:
        session.store.put(replace(session.state[Layers], hidden=known(self.names)))


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
