"""One port: what it passes on, and that it survives readers that go away."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path

import pytest
import rerun as rr
import rich
import viser
from aiohttp import ClientWebSocketResponse, WSMsgType
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.session import commands as do
from ispom_app.session.state import NoticeAdded, State, reduce
from ispom_app.views.rerun.parts import columns_of
from ispom_app.views.rerun.rrd import HEADER
from ispom_app.views.rerun.tape import Tape
from ispom_app.views.viser.portless import PortlessViser
from ispom_app.views.web import files
from ispom_app.views.web.messages import Pane, Ready, command_of, message_of
from ispom_app.views.web.rerun_assets import ViewerFiles, viewer_files
from ispom_app.views.web.tape_reader import HEAD

from tests.app.gui import has_pages
from tests.app.helpers import wait_for
from tests.app.page.served import Served, serving


@pytest.fixture(scope="module")
def panels() -> Iterator[PortlessViser]:
    rich.get_console().quiet = True
    found = PortlessViser("test")
    yield found
    wait_for(lambda: not has_pages(found.server), "viser to part from its pages")
    found.server.stop()


@pytest.mark.parametrize("base", ["/", "/ispom/", "/a/b/"])
def test_everything_comes_through_one_port_under_any_base(tmp_path: Path, panels: PortlessViser, base: str):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "run.rrd").write_bytes(b"rows")

    async def check(at: Served) -> None:
        async def text(path: str) -> str:
            async with at.client.get(at.url + path) as found:
                assert found.status == 200, path
                return await found.text()

        page = await text("")
        assert "<title>ISPOM</title>" in page and '="/' not in page  # no address that leaves the base
        assert "splitter" in await text("web/splitter.js")
        assert "viser" in await text("viser/?darkMode")
        assert await text("rerun/re_viewer_bg.wasm") == "viewer"
        async with at.client.get(f"{at.url}recordings/a/run.rrd") as found:
            assert await found.read() == b"rows" and found.headers["Content-Disposition"] == "attachment"
        async with at.client.ws_connect(f"{at.url}viser", protocols=[f"viser-v{viser.__version__}"]) as ws:
            assert ws.protocol == f"viser-v{viser.__version__}"
            assert (await ws.receive()).type is WSMsgType.BINARY
        async with at.client.ws_connect(f"{at.url}ws") as ws:
            assert (await ws.receive_json())["phase"] == "opening"

    serving(tmp_path, check, viser=panels, base=base)


def test_pictures_of_runs_and_recordings_are_served_and_no_other_images(tmp_path: Path):
    (tmp_path / "a").mkdir()
    for name in ("a/thumbnail.jpg", "mine.rrd", "mine.jpg", "holiday.jpg", "a/notes.yaml"):
        (tmp_path / name).write_bytes(b"x")

    async def check(at: Served) -> None:
        names = ("a/thumbnail.jpg", "mine.jpg", "holiday.jpg", "a/notes.yaml")
        assert [await at.status(f"/pictures/{name}") for name in names] == [200, 200, 404, 404]
        assert await at.status("/pictures/mine.rrd") == 404 and await at.status("/recordings/mine.rrd") == 200
        assert {await at.status(f"/recordings/{name}") for name in names} == {404}, "recordings, and nothing else"

    serving(tmp_path, check)


def test_viewer_files_that_were_not_there_are_looked_for_again(tmp_path: Path):
    missing = [True]

    def files() -> ViewerFiles:
        if missing:
            raise OSError("it is not there")
        return ViewerFiles(b"script", tmp_path / "re_viewer_bg.wasm")

    async def check(at: Served) -> None:
        at.gateway._to = replace(at.gateway._to, viewer=files)
        assert [await at.status("/rerun/re_viewer_bg.wasm") for _ in range(2)] == [503, 503]
        missing.clear()
        assert await at.status("/rerun/re_viewer_bg.wasm") == 200

    serving(tmp_path, check)


def test_a_base_without_its_slash_leads_to_the_page(tmp_path: Path):
    async def check(at: Served) -> None:
        async with at.client.get(at.url.rstrip("/")) as found:
            assert found.status == 200 and found.url.path == "/ispom/"

    serving(tmp_path, check, base="/ispom/")


def test_the_page_may_speak_to_its_own_server_only(tmp_path: Path):
    async def check(at: Served) -> None:
        for path in ("", "viser/"):
            async with at.client.get(at.url + path) as found:
                policy = found.headers["Content-Security-Policy"]
                assert "default-src 'self'" in policy and "http" not in policy
        async with at.client.get(at.url) as found:
            assert "connect-src 'self' blob: data:;" in found.headers["Content-Security-Policy"]

    serving(tmp_path, check)


def test_after_an_upgrade_browsers_get_the_new_viewer(tmp_path: Path):
    async def check(at: Served) -> None:
        script = [b"this version"]
        at.gateway._to = replace(at.gateway._to, viewer=lambda: ViewerFiles(script[0], tmp_path))
        url = f"{at.url}rerun/viewer.js"
        async with at.client.get(url) as found:
            assert found.headers["Cache-Control"] == "no-cache"
            tag = found.headers["ETag"]
        async with at.client.get(url, headers={"If-None-Match": tag}) as found:
            assert found.status == 304
        script[0] = b"the next version"
        async with at.client.get(url, headers={"If-None-Match": tag}) as found:
            assert await found.read() == b"the next version"

    serving(tmp_path, check)


def test_states_go_out_and_commands_come_in(tmp_path: Path):
    async def check(at: Served) -> None:
        async with at.client.ws_connect(f"{at.url}ws") as one, at.client.ws_connect(f"{at.url}ws") as two:
            for ws in (one, two):
                assert (await ws.receive_json())["phase"] == "opening"
            at.session.become(reduce(at.session.state, NoticeAdded("careful")))
            for ws in (one, two):
                assert (await ws.receive_json())["notices"][0]["text"] == "careful"
            await one.send_str('{"do": "pane", "tab": "Explain"}')
            await one.send_str("nonsense")
            await one.send_str('{"do": "seek", "index": 7}')
            while not at.session.commands:
                await asyncio.sleep(0.005)
            assert at.session.commands == [do.Seek(7)] and at.tabs == [{"Explain"}]
        while at.tabs[-1]:
            await asyncio.sleep(0.005)

    serving(tmp_path, check)


def filled(folder: Path, frames: int = 3, **options) -> Tape:
    """A tape of frames of which each has a text."""
    tape = Tape(folder, recording_id="a-run", kinds=lambda: ("video",) * 9, **options)
    tape.open(b"opening")
    for frame in range(frames):
        draw(tape, frame)
    return tape


def draw(tape: Tape, frame: int, text: str = "") -> None:
    tape.put(frame, "decisions", columns_of("decisions", rr.TextDocument(text or f"frame {frame}")))
    tape.came(frame)


class Page:
    """A page with a viewer, at a frame of the session's."""

    def __init__(self, at: Served, ws: ClientWebSocketResponse) -> None:
        self._at, self._ws = at, ws

    async def shows(self, index: int) -> None:
        """The session does."""
        record = ExposureRecord(index, index, "video", (), {}, {}, {})
        self._at.session.become(replace(self._at.session.state, displayed=record))
        while (await self._ws.receive_json()).get("index") != index:
            pass

    async def ready(self, serial: int, run: str = "") -> None:
        await self._ws.send_json({"do": "ready", "run": run, "serial": serial})

    async def begins(self) -> dict[str, str]:
        """The run that the next frame is of."""
        return (await self._ws.receive_json())["begins"]

    async def receives(self) -> tuple[int, int, bool]:
        """The head of the next frame: serial number, frame, and whether that is complete."""
        return HEAD.unpack_from(await self.content())

    async def content(self) -> bytes:
        message = await self._ws.receive_bytes()
        assert message[HEAD.size :].startswith(HEADER)
        return message

    async def receives_nothing(self) -> None:
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(self._ws.receive(), 0.1)


@asynccontextmanager
async def page(at: Served) -> AsyncIterator[Page]:
    async with at.client.ws_connect(f"{at.url}ws") as ws:
        await ws.receive_json()  # the state
        yield Page(at, ws)


def test_a_page_gets_the_frame_that_it_shows(tmp_path: Path):
    async def check(at: Served) -> None:
        at.live.tape = tape = filled(tmp_path)
        async with page(at) as one:
            await one.shows(2)
            await one.receives_nothing()  # it has no viewer yet
            await one.ready(0)
            assert await one.begins() == {"run": tape.run, "recording": "a-run"}
            first = await one.content()
            assert HEAD.unpack_from(first) == (1, 2, True)
            assert first[HEAD.size :].startswith(HEADER + b"opening"), "the first message brings the opening as well"
            await one.shows(0)
            await one.receives_nothing()  # the viewer has not taken in the frame before
            await one.ready(1)
            assert await one.receives() == (2, 0, True)
            await one.ready(2)
            await one.shows(1)
            assert await one.receives() == (3, 1, True)
        async with page(at) as again:
            await again.ready(3, tape.run)
            assert await again.receives() == (4, 1, True), "nobody knows what the page has"
        tape.close()

    serving(tmp_path, check)


def test_a_page_that_is_ready_for_what_was_replaced_gets_nothing(tmp_path: Path):
    """A page that seeks faster than it receives would have to take in frames that nobody wants any more."""

    async def check(at: Served) -> None:
        at.live.tape = tape = filled(tmp_path)
        async with page(at) as one:
            await one.shows(0)
            await one.ready(0)
            await one.begins()
            assert await one.receives() == (1, 0, True)
            await one.ready(0)  # sent before the frame was received
            await one.shows(1)
            await one.receives_nothing()
            await one.shows(2)
            await one.ready(1)
            assert await one.receives() == (2, 2, True)
        tape.close()

    serving(tmp_path, check)


def test_a_frame_that_comes_later_or_changes_is_sent_by_itself(tmp_path: Path):
    async def check(at: Served) -> None:
        requested: list[int] = []
        at.live.tape = tape = filled(tmp_path, request=requested.append)
        async with page(at) as one:
            await one.shows(4)
            await one.ready(0)
            await one.begins()
            assert (await one.receives())[1] == 2, "until it is there the last one"
            await one.ready(1)
            draw(tape, 3)
            at.live.grown.notify()
            assert (await one.receives())[1] == 3
            await one.ready(2)
            tape.came(4, bare=True)
            at.live.grown.notify()
            assert (await one.receives())[1:] == (4, False)
            assert requested == [4]
            await one.ready(3)
            tape.came(4)
            at.live.grown.notify()
            assert (await one.receives())[1:] == (4, True)
            await one.ready(4)
            draw(tape, 4, "the final poses are in it")
            at.live.grown.notify()
            assert (await one.receives())[1:] == (4, True)
        tape.close()

    serving(tmp_path, check)


def test_another_run_begins_when_its_frame_can_be_shown(tmp_path: Path):
    """Until then a page keeps what it has: after a fork the parent stays in sight."""

    async def check(at: Served) -> None:
        first = at.live.tape = filled(tmp_path)
        async with page(at) as one:
            await one.shows(2)
            await one.ready(0)
            await one.begins()
            assert (await one.receives())[1] == 2
            await one.ready(1)
            second = at.live.tape = filled(tmp_path, frames=1, expected=lambda: 3)
            at.live.grown.notify()
            await one.receives_nothing()
            for frame in (1, 2):
                draw(second, frame)
                at.live.grown.notify()
            assert (await one.begins())["run"] == second.run
            assert await one.receives() == (2, 2, True)
        first.close()
        second.close()

    serving(tmp_path, check)


@pytest.mark.parametrize("serial", ['"x"', "-1", "1.5", "null"])
def test_a_page_that_names_no_number_is_not_understood(serial: str):
    assert command_of(f'{{"do": "ready", "serial": {serial}}}') is None
    assert command_of('{"do": "ready", "run": "a", "serial": 3}') == Ready("a", 3)


def test_a_viewer_that_stops_reading_costs_the_others_nothing(tmp_path: Path):
    async def check(at: Served) -> None:
        at.live.tape = tape = filled(tmp_path)
        async with page(at) as stuck, page(at) as other:
            await other.shows(0)
            for each in (stuck, other):  # the first never reads
                await each.ready(0)
            await other.begins()
            await other.receives()
            for serial in range(1, 65):
                draw(tape, 0, str(serial % 10) * 1_000_000)
                for each in (stuck, other):
                    await each.ready(serial)
                at.live.grown.notify()
                assert await other.receives() == (serial + 1, 0, True)
        tape.close()

    serving(tmp_path, check)


def test_a_reader_that_goes_away_harms_nobody(tmp_path: Path):
    async def check(at: Served) -> None:
        (tmp_path / "big.rrd").write_bytes(bytes(20_000_000))
        for _ in range(5):
            _, writer = await asyncio.open_connection("127.0.0.1", at.port)
            head = f"GET /recordings/big.rrd?token={at.access.token} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
            writer.write(head.encode())
            writer.transport.abort()
        async with at.client.ws_connect(f"{at.url}ws") as ws:
            assert (await ws.receive()).type is WSMsgType.TEXT

    serving(tmp_path, check)


def test_a_reader_that_takes_a_file_too_slowly_is_cut_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(files, "SEND_S", 0.05)

    async def check(at: Served) -> None:
        (tmp_path / "big.rrd").write_bytes(bytes(50_000_000))
        _, writer = await asyncio.open_connection("127.0.0.1", at.port, limit=1000)
        writer.write(f"GET /recordings/big.rrd?token={at.access.token} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
        assert at.gateway.connections is not None
        server = at.gateway.connections.server
        while not server.connections:
            await asyncio.sleep(0.005)
        while server.connections:
            await asyncio.sleep(0.005)
        writer.close()

    serving(tmp_path, check)


@pytest.mark.parametrize(
    ("text", "command"),
    [
        ('{"do": "play"}', do.Play()),
        ('{"do": "step_by", "count": -1}', do.StepBy(-1)),
        ('{"do": "step_to", "kind": "stereo", "forwards": false}', do.StepTo("stereo", forwards=False)),
        ('{"do": "step_to", "kind": "car"}', None),
        ('{"do": "play", "how": "fast"}', None),
        ('{"do": "speed", "factor": 1e9}', None),
        ('{"do": ["back"]}', None),
        ('{"do": "pane", "tab": ""}', Pane()),
        ('{"do": "seek"}', None),
        ('{"do": "seek", "index": "far"}', None),
        ('{"do": "seek", "index": 1e999}', None),
        ('{"do": "seek", "index": NaN}', None),
        ('{"do": "seek", "index": ' + "9" * 5000 + "}", None),
        ('{"do": "open", "source": "/etc"}', None),
        ("[" * 60_000, None),
        ('{"do":' * 10_000, None),
        ("[]", None),
        ("{", None),
    ],
)
def test_messages_are_understood_or_ignored(text: str, command: object):
    assert command_of(text) == command


def test_a_state_is_plain_json():
    assert json.loads(json.dumps(message_of(State("double"))))["index"] == -1


def test_the_viewer_comes_out_of_the_wheel():
    viewer = viewer_files()
    assert viewer.wasm.read_bytes()[:4] == b"\0asm"
    # The parts of the viewer's interface that the page stands on.
    for part in ("get_time_range(", "get_active_recording_id(", "set_blueprint(", "open_channel(", "set_time("):
        assert f"\n  {part}" in viewer.script.decode() or f"\n  async {part}" in viewer.script.decode()
