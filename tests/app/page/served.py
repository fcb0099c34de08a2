"""A gateway in front of a session that only notes what it is told, on a port of its own."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from aiohttp import ClientSession
from ispom_app.engine.subscribers import Subscribers
from ispom_app.session import commands as do
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.sources.folders import Folders
from ispom_app.session.state import State
from ispom_app.views.rerun.tape import Tape
from ispom_app.views.viser.portless import PortlessViser
from ispom_app.views.web.access import Access
from ispom_app.views.web.connections import Connections, runner_of
from ispom_app.views.web.gateway import Backends, Gateway
from ispom_app.views.web.rerun_assets import WASM, ViewerFiles

T = TypeVar("T")
COOKIE = "ispom-test"


class FakeSession:
    """A state to show, and the commands that came."""

    def __init__(self, recordings_dir: Path) -> None:
        self.state = State("double")
        self.run: CurrentRun | None = None
        self.changes = Subscribers()
        self.commands: list[do.Command] = []
        self.folders = Folders()
        self._extras: dict[type, object] = {}
        self.recordings_dir = recordings_dir

    def extra(self, kind: type[T]) -> T:
        return self._extras.setdefault(kind, kind())  # type: ignore[return-value]

    def post(self, command: do.Command) -> None:
        self.commands.append(command)

    def become(self, state: State) -> None:
        self.state = state
        self.changes.notify()


class FakeLive:
    """No run yet."""

    def __init__(self) -> None:
        self.tape: Tape | None = None
        self.grown = Subscribers()


@dataclass
class Served:
    """What a test talks to, and what it looks at."""

    port: int
    access: Access
    client: ClientSession
    """Has the token."""
    gateway: Gateway
    session: FakeSession
    live: FakeLive = field(default_factory=FakeLive)
    tabs: list[frozenset[str]] = field(default_factory=list)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}{self.access.base}"

    async def status(self, path: str, headers: dict[str, str | None] | None = None, *, token: bool = True) -> int:
        """Of a request as it stands, whatever that is: 0 where the connection was closed without an answer."""
        sent = {"Host": f"127.0.0.1:{self.port}", "Connection": "close"}
        if token:
            sent["Cookie"] = f"{COOKIE}={self.access.token}"
        lines = [f"{k}: {v}" for k, v in (sent | (headers or {})).items() if v is not None]
        return await self.raw("\r\n".join([f"GET {path} HTTP/1.1", *lines, "", ""]).encode("latin-1"))

    async def raw(self, request: bytes) -> int:
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
        writer.write(request)
        try:
            words = (await reader.readline()).split()
        except ConnectionError:
            words = []
        writer.close()
        return int(words[1]) if words else 0


def serving(
    folder: Path, check: Callable[[Served], Awaitable[None]], *, viser: PortlessViser | None = None, **access: object
) -> None:
    """Runs the check against a gateway; `folder` holds recordings and the viewer's files."""

    async def main() -> None:
        async with served(folder, viser, Access(frozenset({"proxy.example"}), **access)) as found:  # type: ignore[arg-type]
            await asyncio.wait_for(check(found), 60)

    asyncio.run(main())


@asynccontextmanager
async def served(folder: Path, viser: PortlessViser | None, access: Access) -> AsyncIterator[Served]:
    (folder / WASM).write_bytes(b"viewer")
    session, live, tabs = FakeSession(folder), FakeLive(), []
    backends = Backends(session, live, viser, lambda: ViewerFiles(b"script", folder / WASM), folder, tabs.append)  # type: ignore[arg-type]
    gateway = Gateway(backends, access, COOKIE)
    runner = runner_of(gateway.app)
    await runner.setup()
    gateway.connections = Connections(runner)
    server = await asyncio.get_running_loop().create_server(gateway.connections, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    async with ClientSession(headers={"Cookie": f"{COOKIE}={access.token}"}) as client:
        yield Served(port, access, client, gateway, session, live, tabs)
    server.close()
    await runner.cleanup()
