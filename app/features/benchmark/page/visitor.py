"""What a browser asks of the app, without the browser: the page's state, the run's stream and viser's messages.

`python -m ispom_app.features.benchmark.page.visitor URL COUNT reads|idle` opens so many pages, and reads what they
are sent or nothing of it, until it is killed.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import viser
from aiohttp import ClientSession, ClientWebSocketResponse, CookieJar, WSMsgType

from ispom.child import end_with_parent
from ispom.errors import InputError

PATIENCE_S = 3600.0
"""For a run to end."""


class Visitor:
    """One page. `state` is the newest that it was sent, `parts` what of it came once."""

    def __init__(self, talk: ClientWebSocketResponse) -> None:
        self._talk = talk
        self._news = asyncio.Condition()
        self.state: dict[str, Any] = {}
        self.panels_s = 0.0
        """When viser's last message came (time.monotonic)."""

    async def send(self, command: dict[str, Any]) -> None:
        await self._talk.send_str(json.dumps(command))

    async def until(self, holds: Callable[[dict[str, Any]], object], timeout_s: float = PATIENCE_S) -> float:
        """When the state came for which this holds (time.monotonic). TimeoutError where none does, InputError where
        the source cannot be opened."""
        async with self._news, asyncio.timeout(timeout_s):
            await self._news.wait_for(lambda: self._failed or (bool(self.state) and holds(self.state)))
            if self._failed:
                raise InputError(" ".join(notice["text"] for notice in self.state["notices"]))
            return time.monotonic()

    @property
    def _failed(self) -> bool:
        return self.state.get("phase") == "failed"

    async def quiet(self, since_s: float, for_s: float) -> float:
        """Waits until viser has sent nothing for so long; when its last message came, at least `since_s`."""
        while (left := max(self.panels_s, since_s) + for_s - time.monotonic()) > 0:
            await asyncio.sleep(left)
        return max(self.panels_s, since_s)

    async def read_states(self) -> None:
        async for message in self._talk:
            async with self._news:
                self.state = json.loads(message.data)
                self._news.notify_all()

    async def read_panels(self, panels: ClientWebSocketResponse) -> None:
        async for _ in panels:
            self.panels_s = time.monotonic()


async def _read_run(live: ClientWebSocketResponse) -> None:
    """Asks for the next piece whenever one has come."""
    await live.send_str("")
    async for message in live:
        if message.type is WSMsgType.BINARY:
            await live.send_str("")


@asynccontextmanager
async def visiting(address: str, *, reads: bool = True) -> AsyncIterator[Visitor]:
    """A page at the printed address; one that does not read asks for everything all the same."""
    async with ClientSession(cookie_jar=CookieJar(unsafe=True)) as client:
        async with client.get(address) as page:
            place = str(page.url.with_query(None))
        version = f"viser-v{viser.__version__}"
        async with (
            client.ws_connect(f"{place}ws", max_msg_size=0) as talk,
            client.ws_connect(f"{place}live", max_msg_size=0) as live,
            client.ws_connect(f"{place}viser", max_msg_size=0, protocols=[version]) as panels,
        ):
            visitor = Visitor(talk)
            await visitor.send({"do": "pane", "wide": False, "tab": "Explain"})  # without the 3-D scene, a drawing
            if not reads:
                for _ in range(8):
                    await live.send_str("")
                yield visitor
                return
            readers = [visitor.read_states(), visitor.read_panels(panels), _read_run(live)]
            reading = [asyncio.create_task(reader) for reader in readers]
            try:
                yield visitor
            finally:
                for task in reading:
                    task.cancel()


async def _stay(address: str, count: int, reads: bool) -> None:
    """Says when all are there."""
    waiting = [None] * count

    async def one() -> None:
        async with visiting(address, reads=reads):
            waiting.pop()
            if not waiting:
                sys.stdout.write("there\n")
                sys.stdout.flush()
            await asyncio.sleep(PATIENCE_S)

    await asyncio.gather(*(one() for _ in range(count)))


if __name__ == "__main__":
    end_with_parent()
    asyncio.run(_stay(sys.argv[1], int(sys.argv[2]), sys.argv[3] == "reads"))
