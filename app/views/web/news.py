"""What a page is sent of things that grow, in increments.

A feature's are in `features/NAME/page_message.py`: each kind in its `NEWS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...session.current_run import CurrentRun
from ...session.registry import modules
from ...session.session import Session
from ...session.state import State


@dataclass(frozen=True)
class Look:
    """What one page looks at."""

    session: Session
    person: str
    """The key of the person at the page."""
    state: State
    """The session's."""
    local: State
    """The same with the page's own values."""
    run: CurrentRun | None


class News:
    """What one page has been sent so far of one thing. Made for each page that connects."""

    def of(self, look: Look) -> Mapping[str, Any]:
        """What is new to the page, as JSON values by name; empty where nothing is. Where more is left than one message
        takes, it is never empty."""
        raise NotImplementedError(type(self).__name__)


def features_news() -> list[News]:
    """Those of all features, for a page that connects."""
    return [kind() for module in modules("page_message") for kind in module.NEWS]
