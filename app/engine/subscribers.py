"""Callbacks that are called when something changed."""

from __future__ import annotations

from collections.abc import Callable


class Subscribers:
    """Callbacks that any thread may add, remove and call. They get no value; they read it themselves."""

    def __init__(self) -> None:
        self._callbacks: frozenset[Callable[[], None]] = frozenset()

    def add(self, callback: Callable[[], None]) -> None:
        self._callbacks |= {callback}

    def remove(self, callback: Callable[[], None]) -> None:
        self._callbacks -= {callback}

    def notify(self) -> None:
        """Calls them all, in this thread: a callback must return at once."""
        for callback in self._callbacks:
            callback()
