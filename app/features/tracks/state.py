"""What is looked at closely."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

from ...session.state import FeatureState, Opening, State

Panel = Literal["track", "tracks", "lifetimes", "keyframes", "residuals", "geometry"]


@dataclass(frozen=True)
class Inspection(FeatureState):
    selected: str = ""
    """As engine/inspection/selection.py writes it: `track:monocular:181`; empty for nothing."""
    camera: str = ""
    """Whose image is shown; empty for the first that the rig has."""
    panel: Panel = "track"
    """What the tab shows below the image."""

    def reduce(self, event: object) -> Inspection:
        return replace(self, selected="", camera="") if isinstance(event, Opening) else self

    def page(self, state: State) -> dict[str, Any]:
        return {"selected": self.selected, "camera": self.camera, "look": self.panel}
