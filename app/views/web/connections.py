"""Who may connect: sockets of this machine that listen, and so few connections that a flood of strangers' never shuts a
page out, or uses up all files.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
from collections.abc import Callable

from aiohttp import web

from ispom.errors import InputError

MOST = 200
"""Connections at a time: a page has about six, and some systems allow a process 256 open files."""
IDLE_S = 15.0
"""For a whole request to come, on a new connection and between two requests."""
LINGER_S = 1.0
"""For a reader to take an answer to a request whose body nobody wants."""
SHUTDOWN_S = 0.3
"""For requests under way to end when the server does."""
SILENT = logging.getLogger("ispom_app.views.web.http")
"""For aiohttp, which would log a traceback for each malformed request: nobody here can do anything about it."""
SILENT.disabled = True


class Connections:
    """Makes the protocol of each new connection. Where there are too many, the oldest stranger's is closed for it."""

    def __init__(self, runner: web.AppRunner, most: int = MOST) -> None:
        """`runner` is set up already, or else this raises ValueError."""
        if runner.server is None:
            raise ValueError("the runner has no server: call its setup() first")
        self.server = runner.server
        self._most = most
        self._known: set[asyncio.BaseProtocol] = set()

    def __call__(self) -> asyncio.BaseProtocol:
        connections = self.server.connections
        self._known.intersection_update(connections)
        if len(connections) >= self._most:
            stranger = next((c for c in connections if c not in self._known), None)
            if stranger is None or stranger.transport is None:
                return _Refused()
            stranger.transport.abort()
        return self.server()

    def admit(self, request: web.BaseRequest) -> None:
        """Its connection is a page's: it is kept."""
        self._known.add(request.protocol)


def runner_of(app: web.Application) -> web.AppRunner:
    """What runs the app, patient with nobody."""
    return web.AppRunner(
        app,
        access_log=None,
        logger=SILENT,
        keepalive_timeout=IDLE_S,
        lingering_time=LINGER_S,
        shutdown_timeout=SHUTDOWN_S,
    )


class _Refused(asyncio.Protocol):
    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport.close()


PORTS_TRIED = 20
LAST_PORT = 65535
_TAKEN = {errno.EADDRINUSE, errno.EACCES}


def listener(host: str, port: int, report: Callable[[str], None]) -> socket.socket:
    """A socket on the first free port from `port` on (0: any); says which ones are taken. InputError where none is."""
    if not 0 <= port <= LAST_PORT:
        raise InputError(f"--port {port} is no port: give one from 1 to {LAST_PORT}, or 0 for any")
    last = min(port + PORTS_TRIED - 1, LAST_PORT)
    for candidate in range(port, last + 1) if port else (0,):
        try:
            family = socket.getaddrinfo(host, candidate, type=socket.SOCK_STREAM)[0][0]
            return socket.create_server((host, candidate), family=family, backlog=128)
        except (OSError, UnicodeError) as fault:
            if not isinstance(fault, OSError) or fault.errno not in _TAKEN:
                why = fault.strerror if isinstance(fault, OSError) else "not a host name"
                raise InputError(f"{host} cannot be listened on ({why}): give another --host") from fault
            report(f"port {candidate} is taken, trying the next one")
    raise InputError(f"ports {port} to {last} are all taken: give another --port")
