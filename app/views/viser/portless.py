"""viser without a port: only the page's server can pass connections to it.

viser has no option for that. Its server is built with a stand-in for `websockets`' listener, which keeps the function
that serves one connection instead of listening. `Connection` has the methods that this function needs.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import viser
import websockets.asyncio.server
from viser import _messages
from websockets.exceptions import ConnectionClosedOK

log = logging.getLogger(__name__)
CLIENT = Path(viser.__file__).parent / "client" / "build" / "index.html"
"""viser's page, in one file."""
WAITING = 64
"""Most messages of a page that wait for viser; after that the page must wait."""
Handler = Callable[["Connection"], Coroutine[Any, Any, None]]
Send = Callable[[bytes], Coroutine[Any, Any, None]]


class Connection:
    """A page's connection, as viser's loop sees it."""

    def __init__(self, subprotocol: str, send: Send, page: asyncio.AbstractEventLoop) -> None:
        """`send` runs in the loop `page`; it raises ConnectionError where the page is gone."""
        self.subprotocol = subprotocol
        self.arrived: asyncio.Queue[bytes] = asyncio.Queue(WAITING)
        self._send, self._page = send, page

    async def recv(self) -> bytes:
        """The page's next message."""
        return await self.arrived.get()

    async def send(self, data: bytes) -> None:
        """Waits until the page's connection takes it. ConnectionClosedOK where the page is gone."""
        try:
            await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(self._send(data), self._page))
        except (ConnectionError, RuntimeError) as gone:
            raise ConnectionClosedOK(None, None) from gone

    async def close(self, code: int = 1000, reason: str = "") -> None:
        """Called when viser has finished with the page. It does nothing: viser's handler returns next, which closes the
        connection."""


class PageLine:
    """viser, as the loop of a page's connection sees it."""

    def __init__(self, connection: Connection, handler: Handler, viser_loop: asyncio.AbstractEventLoop) -> None:
        self._connection, self._loop = connection, viser_loop
        self.served = asyncio.wrap_future(asyncio.run_coroutine_threadsafe(handler(connection), viser_loop))
        """Finished when viser has finished with the page; with an exception where it could not read a message."""

    async def put(self, data: bytes) -> None:
        """Passes on a message of the page. It waits while viser lags, but not after viser has finished."""
        putting = asyncio.run_coroutine_threadsafe(self._connection.arrived.put(data), self._loop)
        await asyncio.wait({asyncio.wrap_future(putting), self.served}, return_when=asyncio.FIRST_COMPLETED)

    def hang_up(self) -> None:
        """Must be called when the page is gone."""
        self.served.cancel()


def understood(data: bytes) -> bool:
    """Returns whether viser can read a message of a page. An unreadable one would print a traceback on the terminal."""
    try:
        _messages.Message.deserialize(data)
    except Exception:  # viser does not check messages, so wrong types can raise anything
        return False
    return True


def _note_fault(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Logs one line about a message of a page that viser's handlers did not expect."""
    fault = context.get("exception")
    log.warning("a message of a page was not understood (%s)", type(fault).__name__ if fault else context["message"])


class PortlessViser:
    """A viser server that listens nowhere."""

    def __init__(self, label: str) -> None:
        with _no_listener() as handlers:
            self.server = viser.ViserServer(host="127.0.0.1", port=0, label=label, verbose=False)
        self._handler: Handler = handlers[0]
        self.server.get_event_loop().set_exception_handler(_note_fault)
        for share in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):  # a tunnel for the whole world
            self.server._websock_server.unregister_handler(share)

    def connect(self, subprotocol: str, send: Send) -> PageLine:
        """Begins to serve a page; called in the loop that its connection lives in, where `send` runs as well."""
        connection = Connection(subprotocol, send, asyncio.get_running_loop())
        return PageLine(connection, self._handler, self.server.get_event_loop())


@contextmanager
def _no_listener() -> Iterator[list[Handler]]:
    """In this context, viser's server does not listen; the handler of its connections is stored instead."""
    handlers: list[Handler] = []

    @asynccontextmanager
    async def keep(handler: Handler, *_: object, **__: object) -> AsyncIterator[SimpleNamespace]:
        handlers.append(handler)
        yield SimpleNamespace(server=SimpleNamespace(sockets=()))

    listen = websockets.asyncio.server.serve
    websockets.asyncio.server.serve = keep  # type: ignore[assignment]
    try:
        yield handlers
    finally:
        websockets.asyncio.server.serve = listen
