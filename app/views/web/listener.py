"""The port that the page is served on."""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable

from ispom.errors import InputError

PORTS_TRIED = 20
LAST_PORT = 65535
_TAKEN = {errno.EADDRINUSE, errno.EACCES}


def listener(host: str, port: int, say: Callable[[str], None]) -> socket.socket:
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
            say(f"port {candidate} is taken, trying the next one")
    raise InputError(f"ports {port} to {last} are all taken: give another --port")
