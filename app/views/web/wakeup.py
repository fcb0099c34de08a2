"""News from other threads, for coroutines."""

from __future__ import annotations

import asyncio


class Wakeup:
    """Any thread rings; whoever waits in the loop wakes up.

    while True:
        news = wakeup.next()      # before looking, so that nothing is missed in between
        look()
        await news.wait()
    """

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._event = asyncio.Event()

    def next(self) -> asyncio.Event:
        """Set when the bell rings the next time."""
        return self._event

    def ring(self) -> None:
        """From any thread."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        self._event.set()
        self._event = asyncio.Event()
