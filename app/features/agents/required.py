"""What serving an agent takes."""

from __future__ import annotations

from importlib.util import find_spec

from ispom.errors import InputError

LAST_PORT = 65535


def require_sdk(what: str) -> None:
    """InputError where the SDK of the protocol is not installed; `what` needs it."""
    if find_spec("mcp") is None:
        raise InputError(f"{what} takes the extra `agents`: pip install 'ispom[agents]'")


def require_port(flag: str, port: int | None) -> None:
    """InputError for a number that is no port; None is none that is asked for."""
    if port is not None and not 0 <= port <= LAST_PORT:
        raise InputError(f"{flag} is {port}: give a port from 1 to {LAST_PORT}, or 0 for any free one")
