"""The panels of the left pane, found by listing the features: each `features/NAME/panel.py` has `PANELS`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import viser

from ...session.registry import modules
from ...session.state import State

if TYPE_CHECKING:
    from ...session.session import Session


class PanelView(Protocol):
    """A panel on the page. One that also has `refresh(state)` draws there, while its tab is open, what takes long."""

    def show(self, state: State) -> None:
        """Shows another state."""
        ...


@dataclass(frozen=True)
class Panel:
    """Where a panel is, and what makes it."""

    tab: str
    """The name of its tab; empty for above the tabs."""
    place: int
    """Tabs and panels are in the order of their places."""
    make: Callable[[viser.GuiApi, Session], PanelView]


def panels() -> dict[str, list[Panel]]:
    """All panels by tab, in their order."""
    found = [panel for module in modules("panel") for panel in module.PANELS]
    tabs: dict[str, list[Panel]] = {}
    for panel in sorted(found, key=lambda panel: panel.place):
        tabs.setdefault(panel.tab, []).append(panel)
    return tabs
