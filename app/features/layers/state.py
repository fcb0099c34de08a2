"""What the stage draws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...engine.inspection.colouring import Colouring
from ...session.state import FeatureState, State
from ...views.rerun.layers import OPTIONAL


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

    def page(self, state: State) -> dict[str, Any]:
        return {"colour_by": self.colour_by}
