"""What the stage draws."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ...engine.events import Opened
from ...engine.inspection.colouring import Colouring
from ...session.state import FeatureState, State
from ...views.rerun.blueprint import hidden_paths
from ...views.rerun.layers import LAYERS, MEASURES, OPTIONAL

WITHOUT_LINES = frozenset({"monocular", "stereo", "integrated"})
"""Methods, also as they were published, that draw nothing besides points and poses."""


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


def offered(opened: Opened, methods: Iterable[str]) -> tuple[str, ...]:
    """Returns the layers that can show something of a run of these methods."""
    missing = set[str]()
    if opened.truth is None:
        missing |= {"truth", "error"}
    if not opened.external_trajectories:
        missing.add("beside")
    if not opened.sequence.rig.has_stereo:
        missing |= {"depth", "disparity"}
    if opened.map is None:
        missing.add("map")
    if WITHOUT_LINES.issuperset(name.removesuffix(".paper") for name in methods):
        missing.add("overlay")
    return tuple(layer for layer in LAYERS if layer not in missing)


def hidden_now(state: State) -> frozenset[str]:
    """Layers and methods that the views do not show: those that a person chose, and what is in the way of what is
    looked at."""
    found = state[Layers].undrawn | (frozenset({MEASURES}) if state.covers else frozenset())
    return found.union(*(value.in_the_way for value in state.features.values()))
