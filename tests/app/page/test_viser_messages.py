"""What a page sends to viser, and what viser cannot read: no traceback reaches the terminal."""

from __future__ import annotations

import asyncio
import gc
import logging
from pathlib import Path
from typing import Any

import msgspec
import pytest
import rich
import viser
from aiohttp import WSCloseCode, WSMsgType
from ispom_app.views.viser.portless import PortlessViser

from tests.app.gui import uuid_of
from tests.app.page.served import COOKIE, Served, serving

UNREADABLE: list[Any] = [
    {"type": []},
    {"type": {}},
    {"type": None},
    {"type": "NoSuchMessage"},
    {"type": "ViewerCameraMessage"},
    {"type": "GuiUpdateMessage", "uuid": "x"},
    {"type": "GuiUpdateMessage", "uuid": "x", "updates": {}, "more": 1},
    [],
    None,
    7,
]


@pytest.fixture
def panels():
    rich.get_console().quiet = True
    found = PortlessViser("test")
    yield found
    found.server.stop()


def protocols() -> tuple[str, ...]:
    return (f"viser-v{viser.__version__}",)


@pytest.mark.parametrize("drives", [True, False])
def test_what_cannot_be_read_closes_the_connection_quietly(
    tmp_path: Path,
    panels: PortlessViser,
    drives: bool,
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
) -> None:
    async def check(at: Served) -> None:
        headers = {"Cookie": f"{COOKIE}={at.access.token if drives else at.access.onlookers}"}
        for message in [*map(msgspec.msgpack.encode, UNREADABLE), b"", b"\xc1", b"\x81\xa4type\x91\xc0"]:
            async with at.client.ws_connect(f"{at.url}viser", protocols=protocols(), headers=headers) as ws:
                await ws.send_bytes(message)
                while (await ws.receive()).type is WSMsgType.BINARY:
                    pass
                assert ws.close_code == WSCloseCode.INVALID_TEXT, message

    serving(tmp_path, check, viser=panels, onlookers="look" * 8)
    gc.collect()
    assert not [record for record in caplog.records if record.exc_info]
    assert "Traceback" not in capfd.readouterr().err


def test_values_of_a_wrong_kind_are_one_line(
    tmp_path: Path, panels: PortlessViser, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    slider = panels.server.gui.add_slider("a", 0, 10, 1, 5)
    uuid = uuid_of(slider)
    wrong: list[Any] = [
        {"type": "GuiUpdateMessage", "uuid": [], "updates": {}},
        {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": "abc"}},
        {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"no such": 1}},
        {"type": "GuiUpdateMessage", "uuid": uuid, "updates": []},
    ]
    right = {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": 7}}

    async def check(at: Served) -> None:
        async with at.client.ws_connect(f"{at.url}viser", protocols=protocols()) as ws:
            for message in [*wrong, right]:
                await ws.send_bytes(msgspec.msgpack.encode(message))
            while slider.value != 7:
                await asyncio.sleep(0.005)

    with caplog.at_level(logging.WARNING):
        serving(tmp_path, check, viser=panels)
        gc.collect()
    assert not [record for record in caplog.records if record.exc_info]
    assert "Traceback" not in capfd.readouterr().err
