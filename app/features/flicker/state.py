"""Which side of a flicker is drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...session.state import FeatureState, State
from .flicker import Flicker


@dataclass(frozen=True)
class Flickering(FeatureState):
    between: Flicker | None = None
    """Two methods or branches of which one is drawn at a time; None for all as usual."""

    def page(self, state: State) -> dict[str, Any]:
        """Which side is drawn ("a" or "b"), its branch and its method."""
        now = self.between
        return {"flicker": None if now is None else ["b" if now.on_b else "a", now.shown.branch, now.shown.method]}
