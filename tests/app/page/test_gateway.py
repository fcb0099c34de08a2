"""One port: what it passes on, what it refuses, and that it survives readers that go away."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from aiohttp import ClientSession, WSMsgType, web
from ispom_app.page.gateway import Backends, Gateway
from ispom_app.page.messages import Pane, command_of, message_of
from ispom_app.page.rerun_assets import NAMES, viewer_assets
from ispom_app.rerun_log.tape import Tape
from ispom_app.session import commands as do
from ispom_app.session.state import NoticeAdded, State, reduce
from ispom_app.subscribers import Subscribers


class FakeSession:
    """A state to show, and the commands that came."""

    def __init__(self) -> None:
        self.state = State("double")
        self.commands: list[do.Command] = []

    def post(self, command: do.Command) -> None:
        self.commands.append(command)


class FakeLive:
    """No run yet."""

    def __init__(self) -> None:
        self.tape: Tape | None = None
        self.grown = Subscribers()


@asynccontextmanager
async def listening(app: web.Application) -> AsyncIterator[int]:
    runner = web.AppRunner(app, shutdown_timeout=0.1)
    await runner.setup()
    site = web.TCPSite(runner, "127.0.0.1", 0)
    await site.start()
    try:
        yield site._server.sockets[0].getsockname()[1]  # type: ignore[union-attr]
    finally:
        await runner.cleanup()


def backend() -> web.Application:
    """Stands in for viser."""

    async def page(request: web.Request) -> web.Response:
        return web.Response(text=f"viser {request.path_qs}")

    async def socket(request: web.Request) -> web.WebSocketResponse:
        ws = web.WebSocketResponse(protocols=["viser-v1"])
        await ws.prepare(request)
        async for message in ws:
            await ws.send_bytes(b"echo " + message.data)
        return ws

    async def root(request: web.Request) -> web.StreamResponse:
        return await (socket if "Upgrade" in request.headers else page)(request)

    app = web.Application()
    app.add_routes([web.get("/{path:.*}", root)])
    return app


def through(tmp_path: Path, check: Callable[[ClientSession, str, FakeSession, list[bool]], Awaitable[None]]) -> None:
    """Runs the check against a gateway in front of stand-ins."""

    async def main() -> None:
        (tmp_path / "run.rrd").write_bytes(b"rows")
        for name in NAMES:
            (tmp_path / name).write_bytes(b"viewer")
        session, wide = FakeSession(), []
        async with listening(backend()) as port:
            backends = Backends(port, FakeLive(), lambda: tmp_path, wide.append)
            gateway = Gateway(session, backends, tmp_path, {"127.0.0.1"})  # type: ignore[arg-type]
            async with listening(gateway.app) as public, ClientSession() as client:
                await asyncio.wait_for(check(client, f"http://127.0.0.1:{public}", session, wide), 20)

    asyncio.run(main())


def test_everything_comes_through_one_port(tmp_path: Path):
    async def check(client: ClientSession, url: str, session: FakeSession, wide: list[bool]) -> None:
        async def text(path: str) -> str:
            async with client.get(url + path) as found:
                assert found.status == 200, path
                return await found.text()

        assert "<title>ISPOM</title>" in await text("/")
        assert "splitter" in await text("/web/splitter.js")
        assert await text("/viser/a/b?darkMode") == "viser /a/b?darkMode"
        assert await text("/viewer/re_viewer_bg.wasm") == "viewer"
        async with client.get(f"{url}/recordings/run.rrd") as found:
            assert await found.read() == b"rows" and found.headers["Content-Disposition"] == "attachment"
        async with client.ws_connect(f"{url}/viser", protocols=["viser-v1"]) as ws:
            assert ws.protocol == "viser-v1"
            await ws.send_bytes(b"hello")
            assert (await ws.receive()).data == b"echo hello"

    through(tmp_path, check)


def test_the_page_may_speak_to_its_own_server_only(tmp_path: Path):
    async def check(client: ClientSession, url: str, session: FakeSession, wide: list[bool]) -> None:
        for path in ("/", "/viser/"):
            async with client.get(url + path) as found:
                policy = found.headers["Content-Security-Policy"]
                assert "default-src 'self'" in policy and "http" not in policy
        async with client.get(f"{url}/") as found:
            assert "connect-src 'self' blob: data:;" in found.headers["Content-Security-Policy"]

    through(tmp_path, check)


def test_other_sites_are_refused(tmp_path: Path):
    async def check(client: ClientSession, url: str, session: FakeSession, wide: list[bool]) -> None:
        for headers in ({"Host": "evil.example:80"}, {"Origin": "http://evil.example"}, {"Origin": "null"}):
            for path in ("/", "/ws", "/viser/", "/recordings/run.rrd"):
                async with client.get(url + path, headers=headers) as found:
                    assert found.status == 403, (path, headers)
        port = url.rsplit(":", 1)[1]
        async with client.get(
            f"{url}/", headers={"Host": f"localhost:{port}", "Origin": f"http://localhost:{port}"}
        ) as ok:
            assert ok.status == 200

    through(tmp_path, check)


@pytest.mark.parametrize(
    "path", ["/recordings/../secret", "/recordings/%2e%2e/secret", "/web/..%2fserver.py", "/web/no"]
)
def test_nothing_outside_its_folders_is_served(tmp_path: Path, path: str):
    async def check(client: ClientSession, url: str, session: FakeSession, wide: list[bool]) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", int(url.rsplit(":", 1)[1]))
        writer.write(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n".encode())
        assert b" 404 " in (await reader.readline())
        writer.close()

    (tmp_path.parent / "secret").write_text("secret")
    through(tmp_path, check)


def test_states_go_out_and_commands_come_in(tmp_path: Path):
    async def check(client: ClientSession, url: str, session: FakeSession, wide: list[bool]) -> None:
        async with client.ws_connect(f"{url}/ws") as one, client.ws_connect(f"{url}/ws") as two:
            for ws in (one, two):
                assert json.loads((await ws.receive()).data)["phase"] == "opening"
            session.state = reduce(session.state, NoticeAdded("careful"))
            for ws in (one, two):
                assert json.loads((await ws.receive()).data)["notices"][0]["text"] == "careful"
            await one.send_str('{"do": "pane", "wide": true}')
            await one.send_str("nonsense")
            await one.send_str('{"do": "seek", "index": 7}')
            while not session.commands:
                await asyncio.sleep(0.005)
            assert session.commands == [do.Seek(7)] and wide == [True]
        while wide[-1]:
            await asyncio.sleep(0.005)

    through(tmp_path, check)


def test_a_reader_that_goes_away_harms_nobody(tmp_path: Path):
    async def check(client: ClientSession, url: str, session: FakeSession, wide: list[bool]) -> None:
        for _ in range(5):
            _, writer = await asyncio.open_connection("127.0.0.1", int(url.rsplit(":", 1)[1]))
            writer.write(b"GET /viewer/re_viewer_bg.wasm HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            writer.transport.abort()
        async with client.ws_connect(f"{url}/ws") as ws:
            assert (await ws.receive()).type is WSMsgType.TEXT

    through(tmp_path, check)


@pytest.mark.parametrize(
    ("text", "command"),
    [
        ('{"do": "play"}', do.Play()),
        ('{"do": "step", "by": -1}', do.StepBy(-1)),
        ('{"do": "pane", "wide": false}', Pane(False)),
        ('{"do": "seek"}', None),
        ('{"do": "seek", "index": "far"}', None),
        ('{"do": "open", "source": "/etc"}', None),
        ("[]", None),
        ("{", None),
    ],
)
def test_messages_are_understood_or_ignored(text: str, command: object):
    assert command_of(text) == command


def test_a_state_is_plain_json():
    assert json.loads(json.dumps(message_of(State("double"))))["index"] == -1


def test_the_viewer_comes_out_of_the_wheel():
    folder = viewer_assets()
    assert (folder / "re_viewer_bg.wasm").read_bytes()[:4] == b"\0asm"
    script = (folder / "re_viewer.js").read_text()
    # The parts of the viewer's interface that the page stands on.
    for part in ("class WebHandle", "viewer_control(request_bytes)", "start(canvas)"):
        assert part in script
