"""The state of the session, and who hears of a new one."""

from __future__ import annotations

import time
from typing import Unpack

from ..engine.subscribers import Subscribers
from .state import Activity, CoreValues, Event, FeatureChanged, FeatureState, State, changed, reduce


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

    def put(self, value: FeatureState) -> None:
        """A feature keeps this value from now on. Nothing happens if it does already."""
        if self.state[type(value)] != value or type(value) not in self.state.features:
            self.emit(FeatureChanged(value))

    def set(self, **values: Unpack[CoreValues]) -> None:
        """Fields of the core take new values. Nothing happens if they have them."""
        event = changed(**values)
        if any(getattr(self.state, name) != value for name, value in values.items()):
            self.emit(event)

    def busy(self, text: str) -> None:
        """Something that may take long begins."""
        self.emit(changed(activity=Activity(text, time.monotonic())))
