"""The run's stream to one page: as much as the page asks for, and no more."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress

from aiohttp import web

from ..rerun_log.rrd import HEADER
from ..rerun_log.stored_tape import AnyTape
from .wakeup import Wakeup

MESSAGE_BYTES = 1 << 20
"""About how much of the tape goes into one message."""
AHEAD = 8
"""Messages that a page may have asked for at a time; what it asks beyond that is not counted."""


class TapeReader:
    """One page's place on the tape.

    A page that comes back names the `run` that it has, and the item that comes `next`. It sends a message for each
    message that it can take. An answer is either text, the name of a run that begins now, or bytes: the number of the
    item after its last (4 bytes, big-endian), then an `.rrd` stream.
    """

    def __init__(self, tape: Callable[[], AnyTape | None], grown: Wakeup, run: str = "", next_item: int = 0) -> None:
        self._tape, self._grown = tape, grown
        self._run, self._next = run, next_item

    async def serve(self, socket: web.WebSocketResponse) -> None:
        """Until the page goes away."""
        asked = asyncio.Queue[None](AHEAD)
        sending = asyncio.create_task(self._send(socket, asked))
        try:
            async for _ in socket:
                with suppress(asyncio.QueueFull):
                    asked.put_nowait(None)
        finally:
            sending.cancel()

    async def _send(self, socket: web.WebSocketResponse, asked: asyncio.Queue[None]) -> None:
        with suppress(ConnectionError):  # the browser went away
            while True:
                await asked.get()
                news = self._grown.next()
                while not await self._answer(socket):
                    await news.wait()
                    news = self._grown.next()

    async def _answer(self, socket: web.WebSocketResponse) -> bool:
        """Sends what is there; False where there is nothing new."""
        tape = self._tape()
        if tape is None:
            return False
        if tape.run != self._run:
            self._run, self._next = tape.run, 0
            await socket.send_str(tape.run)
        content, following = await asyncio.to_thread(tape.read, self._next, MESSAGE_BYTES)
        if following == self._next:
            return False
        self._next = following
        await socket.send_bytes(following.to_bytes(4, "big") + HEADER + content)
        return True
