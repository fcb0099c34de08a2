"""Metadata of MP4 and MOV files: the keys and values that phones write (QuickTime File Format, metadata atoms)."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

MAX_MOOV_BYTES = 64 << 20
"""Largest size of the header atom; those of films of several hours have less."""
MAX_ATOMS, MAX_KEYS = 10_000, 1_000
_TEXT, _FLOAT32, _FLOAT64, _SIGNED, _UNSIGNED = 1, 23, 24, 21, 22


def quicktime_metadata(path: Path) -> dict[str, str | float]:
    """Returns values by key; empty for a file of another kind, without metadata, or damaged."""
    try:
        moov = _moov(path)
        meta = next((body for name, body in _atoms(moov) if name == b"meta"), b"")
        parts = dict(_atoms(meta)) or dict(_atoms(meta[4:]))
        keys = _keys(parts.get(b"keys", b""))
        metadata: dict[str, str | float] = {}
        for name, body in _atoms(parts.get(b"ilst", b"")):
            number = int.from_bytes(name, "big")
            value = next((_value(data) for kind, data in _atoms(body) if kind == b"data"), None)
            if value is not None and 1 <= number <= len(keys):
                metadata[keys[number - 1]] = value
        return metadata
    except (OSError, struct.error, UnicodeDecodeError):
        return {}


def _moov(path: Path) -> bytes:
    """Returns the content of the header atom; the images before it are skipped."""
    with path.open("rb") as file:
        for _ in range(MAX_ATOMS):
            head = file.read(8)
            if len(head) < 8:
                return b""
            size, name = struct.unpack(">I4s", head)
            taken = 8
            if size == 1:
                (size,) = struct.unpack(">Q", file.read(8))
                taken = 16
            if size < taken:
                return b""
            if name == b"moov":
                return file.read(min(size - taken, MAX_MOOV_BYTES))
            file.seek(size - taken, 1)
    return b""


def _atoms(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Name and content of each atom, up to the first that does not fit."""
    at = 0
    for _ in range(MAX_ATOMS):
        if at + 8 > len(content):
            return
        size, name = struct.unpack(">I4s", content[at : at + 8])
        if size < 8 or at + size > len(content):
            return
        yield name, content[at + 8 : at + size]
        at += size


def _keys(content: bytes) -> list[str]:
    """Returns the names of the keys. Layout: version and flags, count, and entries of size, namespace, name."""
    if len(content) < 8:
        return []
    return [body.decode() for _, body in _atoms(content[8:])][:MAX_KEYS]


def _value(data: bytes) -> str | float | None:
    """Returns the value of an item. Layout: type, locale, value."""
    (kind,) = struct.unpack(">I", data[:4])
    body = data[8:]
    if kind == _TEXT:
        return body.decode()
    if kind in (_SIGNED, _UNSIGNED):
        return float(int.from_bytes(body, "big", signed=kind == _SIGNED))
    if kind in (_FLOAT32, _FLOAT64):
        return float(struct.unpack(">f" if kind == _FLOAT32 else ">d", body)[0])
    return None
