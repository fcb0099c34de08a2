"""The panels of the left pane, found by listing the features: each `features/NAME/panel.py` has `PANELS`.

Their HTML comes from templates that escape all values, because names and notes come from files.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol

import viser

from ispom.errors import as_text

from ...presentation.templating import environment
from ...session.registry import modules
from ...session.state import State

if TYPE_CHECKING:
    from ...session.session import Session


def renderer(package: str | None) -> Callable[..., str]:
    """Returns a function that renders a template of this package, or a shared one: `render("name.html", key=value)`."""

    @cache
    def templates() -> Any:
        return environment(*([package] if package else []), __package__ or "")

    def render(template: str, **values: Any) -> str:
        return as_text(templates().get_template(template).render(values))  # viser sends text only

    return render


class PanelView(Protocol):
    """A panel on the page. It may also have `refresh(state)`, which does slow drawing and is called only while its tab
    is open."""

    def show(self, state: State) -> None:
        """Shows another state."""
        ...


@dataclass(frozen=True)
class Panel:
    """The place of a panel, and the function that makes it."""

    tab: str
    """The name of its tab; empty for a panel above the tabs."""
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
