"""Another site's page, another user of the machine, no token, path tricks, floods: refused, and not a line logged."""

from __future__ import annotations

import asyncio
import logging
import os
from pathlib import Path

import pytest
import rich
import viser
from aiohttp import WSCloseCode, WSMsgType
from ispom_app.views.viser.portless import PortlessViser
from ispom_app.views.web import connections, sockets
from ispom_app.views.web.access import Access, checked_base, checked_host
from ispom_app.views.web.connections import Connections, listener
from ispom_app.views.web.server import Serving

from ispom.errors import InputError
from tests.app.page.attacks import ALLOWED, PATHS, REFUSED
from tests.app.page.served import COOKIE, Served, serving

EVERYWHERE = (
    "/",
    "/ws",
    "/viser",
    "/viser/",
    "/web/app.js",
    "/rerun/viewer.js",
    "/recordings/run.rrd",
    "/pictures/run.jpg",
    "/no",
)
PROXY = {"trusted": frozenset({"proxy.example"})}


@pytest.fixture(autouse=True)
def nothing_logged(caplog: pytest.LogCaptureFixture):
    """A flood of requests must not become a flood of lines."""
    with caplog.at_level(logging.WARNING):
        yield
    assert not caplog.records


@pytest.mark.parametrize("path", EVERYWHERE)
def test_without_the_token_nothing_is_given(tmp_path: Path, path: str):
    (tmp_path / "run.rrd").write_bytes(b"rows")

    async def check(at: Served) -> None:
        assert await at.status(path, token=False) == 401
        for wrong in ("", "x", at.access.token[:-1], at.access.token + "x", "\xff" * 32):
            assert await at.status(path, {"Cookie": f"{COOKIE}={wrong}"}, token=False) == 401
        assert await at.status(f"{path}?token=wrong%FF%00", token=False) == 401
        upgrade = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
        upgrade |= {"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ=="}
        assert await at.status(path, upgrade, token=False) == 401  # type: ignore[arg-type]

    serving(tmp_path, check)


def test_the_printed_address_gives_a_cookie_that_no_script_and_no_other_site_gets(tmp_path: Path):
    async def check(at: Served) -> None:
        async with at.client.get(at.url, params={"token": at.access.token}, headers={"Cookie": ""}) as found:
            assert found.status == 200
            cookie = found.headers["Set-Cookie"]
        assert cookie == f"{COOKIE}={at.access.token}; HttpOnly; SameSite=Strict; Path=/ispom/"
        assert await at.status("/ispom/ws?", {"Cookie": cookie.partition(";")[0]}, token=False) == 400  # no upgrade

    serving(tmp_path, check, base="/ispom/")


def test_a_browser_is_started_with_a_ticket_for_one_visit(tmp_path: Path):
    """The list of processes shows its address to every user of the machine."""

    async def check(at: Served) -> None:
        ticket = at.access.ticket.text
        assert ticket != at.access.token
        assert await at.status(f"/ws?token={ticket}", token=False) == 401
        async with at.client.get(at.url, params={"token": ticket}, headers={"Cookie": ""}) as found:
            assert found.headers["Set-Cookie"].startswith(f"{COOKIE}={at.access.token};")
        assert await at.status(f"/?token={ticket}", token=False) == 401
        assert await at.status("/?token=", token=False) == 401

    serving(tmp_path, check)


def test_each_start_has_a_token_of_its_own():
    one, two = Access(frozenset()), Access(frozenset())
    assert one.token != two.token and len(one.token) >= 32
    assert one.token not in repr(one)


@pytest.mark.parametrize(("host", "origin"), ALLOWED)
def test_own_names_are_answered(tmp_path: Path, host: str, origin: str | None):
    async def check(at: Served) -> None:
        named = {"Host": host.format(port=at.port), "Origin": origin and origin.format(port=at.port)}
        assert await at.status("/", named) == 200

    serving(tmp_path, check, **PROXY)


@pytest.mark.parametrize(("host", "origin"), REFUSED)
def test_other_names_and_other_sites_pages_are_refused(tmp_path: Path, host: str, origin: str | None):
    async def check(at: Served) -> None:
        named = {"Host": host.format(port=at.port), "Origin": origin and origin.format(port=at.port)}
        named = {k: v for k, v in named.items() if v is not None}
        for path in ("/", "/ws", "/viser", "/recordings/run.rrd"):
            assert await at.status(path, named) in (400, 403), path  # type: ignore[arg-type]

    serving(tmp_path, check, **PROXY)


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_another_sites_page_gets_no_file_although_the_browser_sends_the_cookie(tmp_path: Path, site: str):
    """Ports of one host are one site to a browser: a cookie does not keep them apart."""

    async def check(at: Served) -> None:
        fetched = {"Sec-Fetch-Site": site, "Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "script"}
        assert await at.status("/rerun/viewer.js", fetched) == 403  # type: ignore[arg-type]
        framed = fetched | {"Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "iframe"}
        assert await at.status("/", framed) == 403  # type: ignore[arg-type]
        linked = fetched | {"Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}
        assert await at.status("/", linked) == 200  # type: ignore[arg-type]

    serving(tmp_path, check)


@pytest.mark.parametrize("base", ["/", "/ispom/"])
def test_no_address_leads_out_of_the_folders(tmp_path: Path, base: str):
    recordings = tmp_path / "recordings"
    recordings.mkdir()
    for name in ("run.rrd", "run.txt", ".part-run.rrd", "rig.yaml"):
        (recordings / name).write_bytes(b"a file")
    (tmp_path / "secret").write_text("secret")
    (tmp_path / "secret.rrd").write_text("secret")
    os.symlink(tmp_path / "secret.rrd", recordings / "link.rrd")

    async def check(at: Served) -> None:
        assert await at.status(f"{base}recordings/run.rrd") == 200
        for path in PATHS:
            assert await at.status(base.rstrip("/") + path) in (400, 404), path

    serving(recordings, check, base=base)


@pytest.mark.parametrize(
    "request_bytes",
    [
        b"\0" * 100_000,
        b"GET / HTTP/1.1\r\nHost: [\r\n\r\n",
        b"GET /\0 HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET " + b"/" * 20_000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 100_000 + b"\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: localhost\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: -1\r\n\r\n",
        b"POST /viser HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    ],
)
def test_what_is_no_request_is_answered_shortly_or_not_at_all(tmp_path: Path, request_bytes: bytes):
    async def check(at: Served) -> None:
        assert await asyncio.wait_for(at.raw(request_bytes), 10) in (0, 400, 401, 403, 404, 413, 505)
        assert await at.status("/") == 200

    serving(tmp_path, check)


@pytest.mark.parametrize("token", [False, True])
def test_who_sends_a_request_byte_by_byte_is_cut_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, token: bool):
    monkeypatch.setattr(connections, "IDLE_S", 0.2)

    async def check(at: Served) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", at.port)
        if token:
            writer.write(f"GET /?token={at.access.token} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
            assert b"200" in await reader.readline()
        reading = asyncio.create_task(reader.read(1 << 20))
        writer.write(b"GET / HTTP/1.1\r\nX: ")
        while not reader.at_eof() and not writer.is_closing():
            writer.write(b"x")
            await asyncio.sleep(0.01)
            if reading.done():
                reading = asyncio.create_task(reader.read(1 << 20))
        reading.cancel()
        writer.close()

    serving(tmp_path, check)


def test_a_long_body_is_not_read(tmp_path: Path):
    async def check(at: Served) -> None:
        for token in (True, False):
            length = {"Content-Length": str(300 << 20)}
            assert await at.status("/viser/", length, token=token) == 413  # type: ignore[arg-type]

    serving(tmp_path, check)


@pytest.mark.parametrize(("path", "size"), [("ws", 100 << 10), ("viser", 100 << 20)])
def test_a_message_that_is_too_long_ends_its_connection_and_no_other(tmp_path: Path, path: str, size: int):
    """The length alone is enough: not a byte of the message is waited for."""

    async def check(at: Served) -> None:
        head = (
            f"GET /{path} HTTP/1.1\r\nHost: 127.0.0.1\r\nCookie: {COOKIE}={at.access.token}\r\nUpgrade: websocket\r\n"
        )
        head += "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
        head += f"Sec-WebSocket-Protocol: viser-v{viser.__version__}\r\n\r\n"
        async with at.client.ws_connect(f"{at.url}ws") as other:
            reader, writer = await asyncio.open_connection("127.0.0.1", at.port)
            writer.write(head.encode())
            assert b"101" in await reader.readline()
            writer.write(b"\x81\xff" + size.to_bytes(8, "big") + b"mask")
            assert WSCloseCode.MESSAGE_TOO_BIG.to_bytes(2, "big") in await reader.read()
            writer.close()
            await other.send_str('{"do": "play"}')
            while not at.session.commands:
                await asyncio.sleep(0.005)

    rich.get_console().quiet = True
    panels = PortlessViser("test")
    serving(tmp_path, check, viser=panels)
    panels.server.stop()


def test_a_flood_of_commands_ends_its_connection(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sockets.time, "monotonic", lambda: 1.0)  # however long the test takes

    async def check(at: Served) -> None:
        async with at.client.ws_connect(f"{at.url}ws") as ws:
            for _ in range(sockets.COMMANDS_PER_S + 1):
                await ws.send_str('{"do": "step_by", "count": 1}')
            while (await ws.receive()).type is WSMsgType.TEXT:
                pass
            assert ws.close_code == WSCloseCode.POLICY_VIOLATION
        assert len(at.session.commands) == sockets.COMMANDS_PER_S

    serving(tmp_path, check)


def test_a_flood_of_strangers_connections_shuts_no_page_out(tmp_path: Path):
    async def check(at: Served) -> None:
        assert at.gateway.connections is not None
        at.gateway.connections._most = 20
        async with at.client.ws_connect(f"{at.url}ws") as ws:
            assert (await ws.receive_json())["phase"] == "opening"
            idle = [await asyncio.open_connection("127.0.0.1", at.port) for _ in range(100)]
            assert await at.status("/") == 200
            assert len(at.gateway.connections.server.connections) <= 21
            await ws.send_str('{"do": "play"}')
            while not at.session.commands:
                await asyncio.sleep(0.005)
            for _, writer in idle:
                writer.close()

    serving(tmp_path, check)


def test_pages_have_a_bound_as_well(tmp_path: Path):
    async def check(at: Served) -> None:
        assert isinstance(at.gateway.connections, Connections)
        at.gateway.connections._most = 3
        pages = [await at.client.ws_connect(f"{at.url}ws") for _ in range(3)]
        assert await at.status("/") == 0
        await pages[0].close()

    serving(tmp_path, check)


@pytest.mark.parametrize(("base", "kept"), [("", "/"), ("/", "/"), ("ispom", "/ispom/"), ("/a/b", "/a/b/")])
def test_a_base_gets_its_slashes(base: str, kept: str):
    assert checked_base(base) == kept


@pytest.mark.parametrize("base", ["/a b/", "/{x}/", "/../", "/a?b", "http://x/", "/a\0/"])
def test_what_is_no_base_is_reported(base: str):
    with pytest.raises(InputError, match="--base"):
        checked_base(base)


@pytest.mark.parametrize("name", ["", "http://x", "x:80", "x/y", "a b", "[", "x" * 300])
def test_what_is_no_host_is_reported(name: str):
    with pytest.raises(InputError, match="--allow-host"):
        checked_host(name)


@pytest.mark.parametrize("port", [-1, 65536, 99999])
def test_a_port_out_of_range_is_reported(port: int):
    with pytest.raises(InputError, match="--port"):
        listener("127.0.0.1", port, lambda _: None)


@pytest.mark.parametrize("host", ["no such host", "a..b", "x" * 300, "999.1.1.1"])
def test_a_host_that_cannot_be_listened_on_is_reported(host: str):
    with pytest.raises(InputError, match="--host"):
        listener(host, 0, lambda _: None)


@pytest.mark.parametrize(
    ("host", "others"),
    [
        ("127.0.0.1", False),
        ("127.9.9.9", False),
        ("LocalHost", False),
        ("::1", False),
        ("0.0.0.0", True),
        ("box", True),
    ],
)
def test_it_is_known_whether_other_machines_come_in(host: str, others: bool):
    assert Serving(host=host).lets_others_in == others
