"""Clicks in the views of the stage."""

from __future__ import annotations

from dataclasses import replace

from ...engine.inspection.selection import Selection
from ...session.commands import PageCommand, Seek
from ...session.controller import Controller
from ..tracks.commands import Inspection
from .picking import meaning


class PickOnStage(PageCommand, frozen=True):
    """Select the track, or show the frame, that a click on an entity of the views means."""

    path: str
    index: int
    """The frame that the views show."""
    position: tuple[float | None, float | None, float | None]
    """In image pixels as the viewer counts them, or in the shared world."""
    instance: int | None = None
    """Which of the entity's instances was clicked."""

    def execute(self, session: Controller) -> None:
        if session.run is None:
            return
        found = meaning(session.run, self.path, self.index, self.position, self.instance)
        if isinstance(found, Selection):
            session.store.put(replace(session.state[Inspection], selected=str(found)))
        elif found is not None:
            Seek(found).execute(session)
