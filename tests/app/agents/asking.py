"""An agent in the same process: the SDK's client at a server over a session."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from ispom_app.features.agents.agent_session import AgentSession
from ispom_app.features.agents.server import AgentServer
from mcp import Client
from mcp_types import CallToolResult

Script = Callable[["Agent"], Awaitable[Any]]


@dataclass
class Agent:
    client: Client

    async def result(self, tool: str, **arguments: Any) -> CallToolResult:
        return await self.client.call_tool(tool, arguments)

    async def ask(self, tool: str, **arguments: Any) -> dict[str, Any]:
        """The answer as JSON values."""
        found = await self.result(tool, **arguments)
        assert not found.is_error and found.structured_content is not None, found.content
        return found.structured_content

    async def refusal(self, tool: str, **arguments: Any) -> str:
        found = await self.result(tool, **arguments)
        assert found.is_error, found.structured_content
        return found.content[0].text  # type: ignore[union-attr]


async def connected(server: Any, script: Script) -> Any:
    """`server` is anything that the SDK's client takes."""
    async with Client(server) as client:
        return await script(Agent(client))


def asked(agents: AgentSession, script: Script, log: list[str] | None = None) -> Any:
    """What a script finds at a session."""
    lines = [] if log is None else log
    return asyncio.run(connected(AgentServer(agents, lines.append), script))


async def first_failing_check(agent: Agent, method: str) -> tuple[str, int]:
    """What an agent does that knows nothing of the source: from the first loss to the check behind it, and the first
    frame at which that check failed."""
    while not (await agent.ask("compute", seconds=60.0))["done"]:
        pass
    losses = (await agent.ask("events", least_severity="lost", method=method))["rows"]
    frame = losses[0]["frame"]
    (verdict,) = (await agent.ask("verdict_at", frame=frame, method=method))["verdicts"]
    assert verdict["severity"] == "lost" and verdict["frame"] == frame
    key = verdict["decisive"]["key"]
    over_time = await agent.ask("checks_over_time", key=key)
    return key, over_time["first_failed"]
