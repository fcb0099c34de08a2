"""Sources that are no paths: cameras of this machine, and addresses of streams, shown without their secrets."""

from __future__ import annotations

import re

DEVICE = "camera:"
MAX_SEED = 2**32 - 1
"""Of a simulation."""
SCHEMES = ("http", "https", "rtsp", "rtsps", "rtmp", "udp", "tcp")
_SCHEME = re.compile(r"([a-zA-Z][a-zA-Z0-9+.-]*)://")


def is_device(source: str) -> bool:
    """Whether it names a camera of this machine: `camera:0`."""
    return source.startswith(DEVICE)


def is_address(source: str) -> bool:
    """Whether it is an address, of a kind that can be opened or not."""
    return _SCHEME.match(source) is not None


def scheme(address: str) -> str:
    """What an address begins with, in small letters."""
    match = _SCHEME.match(address)
    return match[1].lower() if match else ""


def without_secrets(source: str) -> str:
    """The source without the user's name and password that an address may hold, and without its query's values.

    A password may hold @ and / itself: what stands before the last @ is removed, in doubt a part of the path, too.
    """
    match = _SCHEME.match(source)
    if match is None:
        return source
    rest, mark, _ = source[match.end() :].partition("?")
    before, at, after = rest.rpartition("@")
    if at and (":" in before or "/" not in before):
        rest = after
    return match[0] + rest + ("?…" if mark else "")
