"""What the addresses of the start screen answer, and to whom."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path

import pytest
from aiohttp import web
from aiohttp.test_utils import TestClient, TestServer
from ispom_app.features.runs.routes import routes
from ispom_app.session import commands as do
from ispom_app.session.session import Session
from ispom_app.session.sources.folders import Folders

from tests.app.helpers import started, wait_for
from tests.sequences.kitti_folder import make_drive


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    (tmp_path / "root").mkdir()
    found = started(tmp_path / "recordings", "double:20", autoplay=False, folders=Folders(tmp_path / "root"))
    found.post(do.Seek(3))
    wait_for(lambda: found.state.index == 3, "a few frames")
    yield found
    assert found.close(5.0)


def asked(session: Session, check: Callable[[TestClient], Awaitable[None]], may_drive: bool = True) -> None:
    async def main() -> None:
        app = web.Application()
        app.add_routes(routes(session, lambda _: may_drive, "/"))
        async with TestClient(TestServer(app)) as client:
            await check(client)

    asyncio.run(main())


def test_the_table_has_the_live_run_the_lessons_and_no_fault_without_a_recordings_folder(session: Session) -> None:
    async def check(client: TestClient) -> None:
        async with client.get("/runs") as answer:
            found = await answer.json()
        assert [row["key"] for row in found["rows"]] == ["live:0"] and found["rows"][0]["shown"]
        assert {"name", "title", "minutes", "steps", "done"} == set(found["lessons"][0])

    asked(session, check)


def test_only_who_may_change_the_session_looks_into_folders_and_only_below_the_root(
    session: Session, tmp_path: Path
) -> None:
    make_drive(tmp_path / "root")
    make_drive(tmp_path / "outside")
    os.symlink(tmp_path / "outside", tmp_path / "root" / "link")

    async def check(client: TestClient) -> None:
        async with client.get("/folders") as answer:
            found = await answer.json()
        assert found["above"] is None and "link" not in [entry["name"] for entry in found["entries"]]
        for place in (str(tmp_path / "outside"), "/", f"{tmp_path}/root/../outside"):
            async with client.get("/folders", params={"in": place}) as answer:
                assert answer.status != 200 or not (await answer.json())["entries"]
        for place in ("relative", "/\0", "~"):
            async with client.get("/folders", params={"in": place}) as answer:
                assert answer.status == 404

    async def refused(client: TestClient) -> None:
        async with client.get("/folders") as answer:
            assert answer.status == 403

    asked(session, check)
    asked(session, refused, may_drive=False)


@pytest.mark.parametrize(
    ("address", "status"),
    [
        ("frame?branch=0&at=2&width=100", 200),
        ("frame?branch=0&at=2&method=stereo", 200),
        ("frame", 200),
        ("frame?branch=0&at=999", 404),
        ("frame?branch=9", 404),
        ("frame?width=100000", 404),
        ("frame?branch=-1", 400),
        ("frame?at=%F0%9D%9F%98", 400),
        ("comparison", 404),
        ("differences?a=../secret&b=x", 404),
    ],
)
def test_pictures_and_comparisons_of_what_is_there(session: Session, address: str, status: int) -> None:
    async def check(client: TestClient) -> None:
        async with client.get(f"/{address}") as answer:
            assert answer.status == status
            if status == 200:
                assert (await answer.read())[:2] == b"\xff\xd8"

    asked(session, check)
