"""viser is reached by the page's server alone, and has no way out."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator

import msgspec
import psutil
import pytest
import rich
import viser
import websockets.asyncio.server
from ispom_app.views.viser.portless import PageLine, PortlessViser

from tests.app.gui import has_pages, understood_messages, work_off
from tests.app.helpers import wait_for

VERSION = f"viser-v{viser.__version__}"


@pytest.fixture
def found() -> Iterator[PortlessViser]:
    rich.get_console().quiet = True
    made = PortlessViser("test")
    yield made
    wait_for(lambda: not has_pages(made.server), "viser to part from its pages")
    made.server.stop()


def with_a_page(found: PortlessViser, check: Callable[[PageLine, asyncio.Queue[bytes]], Awaitable[None]]) -> None:
    async def main() -> None:
        sent: asyncio.Queue[bytes] = asyncio.Queue()
        line = found.connect(VERSION, sent.put)
        try:
            await asyncio.wait_for(check(line, sent), 20)
        finally:
            line.hang_up()

    asyncio.run(main())


def listening() -> set[tuple[str, int]]:
    return {tuple(c.laddr) for c in psutil.Process().net_connections("inet") if c.status == psutil.CONN_LISTEN}


def test_viser_listens_nowhere():
    before, listen = listening(), websockets.asyncio.server.serve
    made = PortlessViser("test")
    assert listening() == before
    assert websockets.asyncio.server.serve is listen
    made.server.stop()


def test_a_page_gets_the_panels(found: PortlessViser):
    found.server.gui.add_button("press me")

    async def check(line: PageLine, sent: asyncio.Queue[bytes]) -> None:
        while len(await sent.get()) < 100:
            pass
        assert has_pages(found.server)

    with_a_page(found, check)


def test_no_tunnel_to_the_world_can_be_requested(found: PortlessViser, monkeypatch: pytest.MonkeyPatch):
    """The button is hidden, but any page could send what it sends."""
    requests: list[object] = []
    monkeypatch.setattr(viser.ViserServer, "request_share_url", lambda *_, **__: requests.append("tunnel"))

    async def check(line: PageLine, sent: asyncio.Queue[bytes]) -> None:
        for message in ({"type": "ShareUrlRequest"}, {"type": "ShareUrlDisconnect"}):
            await line.put(msgspec.msgpack.encode(message))
        while line._connection.arrived.qsize():
            await asyncio.sleep(0)
        work_off(found.server)

    with_a_page(found, check)
    assert not requests
    assert not understood_messages(found.server) & {"ShareUrlRequest", "ShareUrlDisconnect"}


@pytest.mark.parametrize(
    "nonsense", [b"", b"\xc1", msgspec.msgpack.encode({"type": "NoSuchMessage"}), b"\x93" * 100_000]
)
def test_a_page_that_sends_nonsense_is_left_alone_and_no_other(found: PortlessViser, nonsense: bytes):
    async def check(line: PageLine, sent: asyncio.Queue[bytes]) -> None:
        await line.put(nonsense)
        await asyncio.wait({line.served})
        assert line.served.exception() is not None
        await line.put(b"more, and nobody waits for it")

    with_a_page(found, check)


def test_a_client_of_another_version_is_turned_away(found: PortlessViser):
    async def main() -> None:
        async def nowhere(_: bytes) -> None: ...

        await asyncio.wait_for(found.connect("viser-v0.0.1", nowhere).served, 20)

    asyncio.run(main())


def test_a_page_that_is_gone_leaves_nothing_behind(found: PortlessViser):
    async def gone(_: bytes) -> None:
        raise ConnectionResetError

    async def main() -> None:
        await asyncio.wait_for(found.connect(VERSION, gone).served, 20)

    asyncio.run(main())
    assert not has_pages(found.server)
