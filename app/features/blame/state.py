"""What the page says of what moved the poses shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...engine.events import Opened
from ...session.state import FeatureState, Opening, State
from .found import PoseBlame


@dataclass(frozen=True, eq=False)
class Blames(FeatureState):
    run: int = -1
    """The number of the run that was asked about."""
    index: int = -1
    """The frame that was asked about."""
    found: tuple[PoseBlame, ...] = ()
    """By method, of its newest pose up to that frame; empty until somebody asks."""
    silent: tuple[tuple[str, str], ...] = ()
    """Methods without an answer, and why."""
    doing: str = ""
    """What is done for the answer now; empty once it is there."""

    def reduce(self, event: object) -> Blames:
        return Blames() if isinstance(event, Opening | Opened) else self

    def at(self, state: State) -> Blames:
        """Returns it where it is of the frame shown, and else that nobody asked."""
        return self if (self.run, self.index) == (state.run, state.index) else Blames()

    def page(self, state: State) -> dict[str, Any]:
        return {"blame": [each.method for each in self.at(state).found]}
