"""What the stage draws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...engine.inspection.colouring import Colouring
from ...session.state import FeatureState, State
from ...views.rerun.blueprint import hidden_paths
from ...views.rerun.layers import MEASURES, OPTIONAL


@dataclass(frozen=True)
class Layers(FeatureState):
    hidden: frozenset[str] = frozenset()
    """Layers and methods that are not drawn."""
    chosen: frozenset[str] = frozenset()
    """Layers that are drawn though they are optional."""
    colour_by: Colouring = "state"
    """What the colours of tracks mean."""

    @property
    def undrawn(self) -> frozenset[str]:
        """All layers and methods that are not drawn."""
        return self.hidden | (OPTIONAL - self.chosen)

    def reduce(self, event: object) -> Layers:
        return self  # also over another source

    def address(self) -> dict[str, list[str]]:
        return {"hidden": sorted(self.hidden), "layers": sorted(self.chosen)}

    def page(self, state: State) -> dict[str, Any]:
        hidden = hidden_paths(state.methods, hidden_now(state), self.colour_by, state.cameras)
        return {"colour_by": self.colour_by, "hidden": hidden}


def hidden_now(state: State) -> frozenset[str]:
    """Layers and methods that the views do not show: those that a person chose, and what is in the way of what is
    looked at."""
    found = state[Layers].undrawn | (frozenset({MEASURES}) if state.covers else frozenset())
    return found.union(*(value.in_the_way for value in state.features.values()))
