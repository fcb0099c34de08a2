"""Streamable HTTP on 127.0.0.1, for whoever has the token."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from socket import socket
from threading import Thread
from typing import Any
from urllib.parse import parse_qs

import uvicorn
from mcp.server.mcpserver import MCPServer
from mcp.server.transport_security import TransportSecuritySettings

from ...session.session import Session
from ...views.web.access import Access
from ...views.web.connections import listener
from .agent_session import AgentSession
from .server import AgentServer

HOST, PATH = "127.0.0.1", "/mcp"
MOST_BYTES = 1 << 20
"""Most bytes of a request; the longest argument is a condition."""
_NO_TOKEN = (
    b"This server needs its token: use the address that ISPOM printed in its terminal, or Authorization: Bearer TOKEN\n"
)

Scope = MutableMapping[str, Any]
App = Callable[[Scope, Callable[[], Awaitable[Any]], Callable[[Any], Awaitable[None]]], Awaitable[None]]


def application(server: MCPServer, port: int, knows: Callable[[str], bool]) -> App:
    """The server behind a token, which `knows` accepts, under the names of this machine only."""
    names = [f"{name}:{port}" for name in (HOST, "localhost")]
    security = TransportSecuritySettings(allowed_hosts=names, allowed_origins=[f"http://{name}" for name in names])
    inner = server.streamable_http_app(
        streamable_http_path=PATH, host=HOST, transport_security=security, max_request_body_size=MOST_BYTES
    )

    async def checked(scope: Scope, receive: Any, send: Any) -> None:
        if scope["type"] == "http" and not knows(_token(scope)):
            head = [(b"content-type", b"text/plain; charset=utf-8"), (b"cache-control", b"no-store")]
            await send({"type": "http.response.start", "status": 401, "headers": head})
            await send({"type": "http.response.body", "body": _NO_TOKEN})
            return
        await inner(scope, receive, send)

    return checked


def _token(scope: Scope) -> str:
    """What a request has as its token: in its header, or else in its address."""
    headers = {name.lower(): value for name, value in scope["headers"]}
    kind, _, found = headers.get(b"authorization", b"").decode("latin-1").partition(" ")
    if kind.lower() == "bearer":
        return found.strip()
    return (parse_qs(scope["query_string"].decode("latin-1")).get("token") or [""])[0]


async def serve_http(server: MCPServer, port: int) -> None:
    """Serves until SIGINT or SIGTERM. InputError where no port is free."""
    access = Access(frozenset())
    listening = listener(HOST, port, _print)
    _print(f"ISPOM's tools are at {_address(listening)}{access.token}   (Ctrl-C ends it)")
    await _server(server, listening, access).serve(sockets=[listening])


@dataclass(frozen=True)
class BesidePage:
    """A server that goes on in its own thread."""

    address: str
    """Without the token, which follows."""
    server: uvicorn.Server

    def end(self) -> None:
        """It answers no more, soon."""
        self.server.should_exit = True


def serve_beside_page(session: Session, port: int, access: Access) -> BesidePage:
    """Serves tools over the session of a page, in a thread of its own, to whoever has a token of the page: they look,
    and move nothing that people see. InputError where no port is free."""
    agents = AgentSession(session, shared=True)
    listening = listener(HOST, port, _print)
    server = _server(AgentServer(agents, _print), listening, access)
    Thread(target=lambda: asyncio.run(server.serve(sockets=[listening])), name="agents", daemon=True).start()
    _print(f"An agent can ask at {_address(listening)}{access.onlookers or access.token}")
    return BesidePage(_address(listening), server)


def _server(server: MCPServer, listening: socket, access: Access) -> uvicorn.Server:
    app = application(server, listening.getsockname()[1], access.knows)
    return uvicorn.Server(uvicorn.Config(app, access_log=False, log_level="warning", log_config=None))


def _address(listening: socket) -> str:
    """Without the token, which follows."""
    return f"http://{HOST}:{listening.getsockname()[1]}{PATH}?token="


def _print(text: str) -> None:
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()
