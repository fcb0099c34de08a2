"""Streamable HTTP on 127.0.0.1, for whoever has the token."""

from __future__ import annotations

import secrets
import sys
from collections.abc import Awaitable, Callable, MutableMapping
from hmac import compare_digest
from typing import Any
from urllib.parse import parse_qs

import uvicorn
from mcp.server.mcpserver import MCPServer
from mcp.server.transport_security import TransportSecuritySettings

from ...views.web.connections import listener

HOST, PATH = "127.0.0.1", "/mcp"
MOST_BYTES = 1 << 20
"""Of a request: the longest argument is a condition."""
_NO_TOKEN = (
    b"This server needs its token: use the address that ISPOM printed in its terminal, or Authorization: Bearer TOKEN\n"
)

Scope = MutableMapping[str, Any]
App = Callable[[Scope, Callable[[], Awaitable[Any]], Callable[[Any], Awaitable[None]]], Awaitable[None]]


def application(server: MCPServer, port: int, token: str) -> App:
    """The server behind its token, under the names of this machine only."""
    names = [f"{name}:{port}" for name in (HOST, "localhost")]
    security = TransportSecuritySettings(allowed_hosts=names, allowed_origins=[f"http://{name}" for name in names])
    inner = server.streamable_http_app(
        streamable_http_path=PATH, host=HOST, transport_security=security, max_request_body_size=MOST_BYTES
    )

    async def checked(scope: Scope, receive: Any, send: Any) -> None:
        if scope["type"] == "http" and not compare_digest(_token(scope).encode(errors="replace"), token.encode()):
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
    listening = listener(HOST, port, _print)
    port, token = listening.getsockname()[1], secrets.token_urlsafe(24)
    config = uvicorn.Config(application(server, port, token), access_log=False, log_level="warning")
    _print(f"ISPOM's tools are at http://{HOST}:{port}{PATH}?token={token}   (Ctrl-C ends it)")
    await uvicorn.Server(config).serve(sockets=[listening])


def _print(text: str) -> None:
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()
