"""Sources other than paths: cameras of this machine, and addresses of streams, which are shown without secrets."""

from __future__ import annotations

import re

DEVICE_PREFIX = "camera:"
MAX_SEED = 2**32 - 1
"""Largest seed of a simulation."""
SCHEMES = ("http", "https", "rtsp", "rtsps", "rtmp", "udp", "tcp")
_SCHEME = re.compile(r"([a-zA-Z][a-zA-Z0-9+.-]*)://")


def is_device(source: str) -> bool:
    """Checks whether a source is a camera of this machine: `camera:0`."""
    return source.startswith(DEVICE_PREFIX)


def is_address(source: str) -> bool:
    """Checks whether a source is an address, also one that cannot be opened."""
    return _SCHEME.match(source) is not None


def scheme(address: str) -> str:
    """Returns the scheme of an address (http, rtsp ...) in lower case."""
    match = _SCHEME.match(address)
    return match[1].lower() if match else ""


def without_secrets(source: str) -> str:
    """Returns the source without user name and password, and without the values of its query.

    As a password may contain @ and /, all before the last @ is removed, which may include a part of the path.
    """
    match = _SCHEME.match(source)
    if match is None:
        return source
    rest, mark, _ = source[match.end() :].partition("?")
    before, at, after = rest.rpartition("@")
    if at and (":" in before or "/" not in before):
        rest = after
    return match[0] + rest + ("?…" if mark else "")
