"""What the page says of what moved the pose shown."""

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
    found: tuple[PoseBlame, ...] = ()
    """At one frame, by method; empty until somebody asks."""

    def reduce(self, event: object) -> Blames:
        return Blames() if isinstance(event, Opening | Opened) else self

    def at(self, state: State) -> tuple[PoseBlame, ...]:
        """What is known of the frame shown."""
        shown = state.displayed
        here = shown is not None and self.run == state.run
        return tuple(each for each in self.found if here and shown is not None and each.index == shown.index)

    def page(self, state: State) -> dict[str, Any]:
        return {"blame": [each.method for each in self.at(state)]}
