"""How many connections there may be: a flood of strangers' connections never shuts a page out, or uses up all files."""

from __future__ import annotations

import asyncio
import logging

from aiohttp import web

MOST = 200
"""Connections at a time: a page has about six, and some systems allow a process 256 open files."""
IDLE_S = 15.0
"""For a whole request to come, on a new connection and between two requests."""
SILENT = logging.getLogger("ispom_app.page.http")
"""For aiohttp, which would log a traceback for each malformed request: nobody here can do anything about it."""
SILENT.disabled = True


class Connections:
    """Makes the protocol of each new connection. Where there are too many, the oldest stranger's is closed for it."""

    def __init__(self, server: web.Server, most: int = MOST) -> None:
        self._server, self._most = server, most
        self._known: set[asyncio.BaseProtocol] = set()

    def __call__(self) -> asyncio.BaseProtocol:
        connections = self._server.connections
        self._known.intersection_update(connections)
        if len(connections) >= self._most:
            stranger = next((c for c in connections if c not in self._known), None)
            if stranger is None or stranger.transport is None:
                return _Refused()
            stranger.transport.abort()
        return self._server()

    def admit(self, request: web.BaseRequest) -> None:
        """Its connection is a page's: it is kept."""
        self._known.add(request.protocol)


class _Refused(asyncio.Protocol):
    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport.close()
