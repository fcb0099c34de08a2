"""The state of the session, and who hears of a new one."""

from __future__ import annotations

import time

from ..engine.subscribers import Subscribers
from .state import Activity, Event, State, changed, reduce


class Store:
    """Written by the worker's thread, read by any."""

    def __init__(self, state: State) -> None:
        self.state = state
        self.changes = Subscribers()
        """Called, in the worker's thread, at each new state."""

    def emit(self, *events: Event) -> None:
        """Each event makes a new state."""
        for event in events:
            self.state = reduce(self.state, event)
            self.changes.notify()

    def set(self, **values: object) -> None:
        """Plain fields take new values: see `changed`. Nothing happens where they have them."""
        event = changed(**values)
        if any(getattr(self.state, name) != value for name, value in values.items()):
            self.emit(event)

    def busy(self, text: str) -> None:
        """Something that may take long begins."""
        self.emit(changed(activity=Activity(text, time.monotonic())))
