"""Streamable HTTP: answered to whoever has the token, under a name of this machine, and to nobody else."""

from __future__ import annotations

import asyncio
import http.client
import socket
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import uvicorn
from ispom_app.features.agents.agent_session import AgentSession
from ispom_app.features.agents.http import PATH, application, serve_beside_page
from ispom_app.features.agents.server import AgentServer
from ispom_app.session import moves
from ispom_app.session.branches.state import Branches
from ispom_app.views.web.access import Access

from tests.app.agents.asking import Agent, connected
from tests.app.helpers import started

TOKEN = "a-token-of-the-test"
BODY = b'{"jsonrpc": "2.0", "id": 1, "method": "tools/list"}'
JSON = {"Content-Type": "application/json", "Accept": "application/json, text/event-stream"}


@pytest.fixture
def agents(tmp_path: Path) -> Iterator[AgentSession]:
    session = started(tmp_path, "double:7", autoplay=False)
    yield AgentSession(session, ("double:7",))
    session.close(5)


def served(agents: AgentSession, script: Callable[[int], Awaitable[Any]], log: list[str]) -> Any:
    """What a script finds at the port of a server."""

    async def run() -> Any:
        listening = socket.create_server(("127.0.0.1", 0))
        port = listening.getsockname()[1]
        app = application(AgentServer(agents, log.append), port, Access(frozenset(), token=TOKEN).knows)
        server = uvicorn.Server(uvicorn.Config(app, log_level="error", access_log=False))
        serving = asyncio.create_task(server.serve(sockets=[listening]))
        while not server.started:
            await asyncio.sleep(0)
        try:
            return await script(port)
        finally:
            server.should_exit = True
            await serving

    return asyncio.run(run())


def status(port: int, path: str, headers: dict[str, str]) -> int:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    try:
        connection.request("POST", path, BODY, JSON | headers)
        return connection.getresponse().status
    finally:
        connection.close()


def test_an_agent_with_the_token_is_answered(agents: AgentSession) -> None:
    async def script(port: int) -> dict[str, Any]:
        async def ask(agent: Agent) -> dict[str, Any]:
            await agent.ask("compute")
            return await agent.ask("summary")

        return await connected(f"http://127.0.0.1:{port}{PATH}?token={TOKEN}", ask)

    log: list[str] = []
    assert served(agents, script, log)["computed"] == len(agents.run.history) > 0
    assert [line.split()[1] for line in log] == ["compute", "summary"] and TOKEN not in "".join(log)


def test_nobody_else_is(agents: AgentSession) -> None:
    bearer = {"Authorization": f"Bearer {TOKEN}"}
    requests = {
        "no token": (PATH, {}),
        "wrong token": (f"{PATH}?token={TOKEN}x", {}),
        "wrong bearer": (PATH, {"Authorization": "Bearer x"}),
        "not ASCII": (f"{PATH}?token=%ff", {}),
        "elsewhere": ("/", {}),
        "another name": (PATH, bearer | {"Host": "evil.example.org"}),
        "a page of another site": (PATH, bearer | {"Origin": "http://evil.example.org"}),
    }

    async def script(port: int) -> dict[str, int]:
        return {name: await asyncio.to_thread(status, port, *request) for name, request in requests.items()}

    log: list[str] = []
    found = served(agents, script, log)
    assert list(found.values()) == [401, 401, 401, 401, 401, 421, 403]
    assert all(line.startswith("agents: Invalid ") for line in log)  # no tool was called


def test_beside_a_page_an_agent_looks_and_moves_nothing(agents: AgentSession) -> None:
    """The person's run is there for it, with the token of those who only look, too."""
    access = Access(frozenset(), onlookers="an onlooker")
    agents.compute(None, 60.0)
    agents.carry_out(lambda controller: controller.player.move(*moves.seek(controller.run, 3)))
    beside = serve_beside_page(agents.session, 0, access)

    async def script(agent: Agent) -> dict[str, Any]:
        for name, arguments in {
            "compute": {},
            "open_run": {"source": "sim:tiny"},
            "open_branch": {"number": 0},
            "fork": {"frame": 2, "settings": {}},
        }.items():
            assert "person" in await agent.refusal(name, **arguments)
        await agent.ask("verdict_at", frame=1)
        return await agent.ask("summary")

    try:
        address = beside.address + "an onlooker"
        found = asyncio.run(connected(address, script))
    finally:
        beside.end()
    assert found["shown"] == 3 and found["computed"] == len(agents.run.history)
    assert agents.state.index == 3 and len(agents.state[Branches].all) == 1
