"""Films as other programs write them: atoms of MP4 and MOV files changed after they were written."""

from __future__ import annotations

import struct
from pathlib import Path

CONTAINERS = (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"edts")


def changed(path: Path, name: bytes, change: bytes | None, at: int = 0) -> Path:
    """With the content of all atoms of this name replaced or, from an offset `at` in it, overwritten.

    Lengths follow. The images must come before the header, as OpenCV writes them.
    """
    path.write_bytes(_rebuilt(path.read_bytes(), name, change, at))
    return path


def with_edits(path: Path, edits: list[tuple[int, int]]) -> Path:
    """With an edit list of (duration [movie's units], first time [media's units], -1 for nothing)."""
    entries = b"".join(struct.pack(">IiI", duration, time, 1 << 16) for duration, time in edits)
    return changed(path, b"elst", struct.pack(">II", 0, len(edits)) + entries)


def scales(path: Path) -> tuple[int, int]:
    """Units per second of the movie's and of the media's times."""
    content = path.read_bytes()
    found = []
    for name in (b"mvhd", b"mdhd"):
        at = content.index(name) + 4
        found.append(struct.unpack_from(">I", content, at + 12)[0])
    return found[0], found[1]


def turned(path: Path, degrees: int) -> Path:
    """With a display matrix that turns the images clockwise by a multiple of 90 degrees."""
    a, b, c, d = {90: (0, 1, -1, 0), 180: (-1, 0, 0, -1), 270: (0, -1, 1, 0)}[degrees]
    one = 1 << 16
    return changed(path, b"tkhd", struct.pack(">9i", a * one, b * one, 0, c * one, d * one, 0, 0, 0, 1 << 30), 40)


def with_aspect(path: Path, horizontal: int, vertical: int) -> Path:
    """With pixels of this width and height (MP4 and MOV: pasp)."""
    return changed(path, b"pasp", struct.pack(">II", horizontal, vertical))


def _rebuilt(content: bytes, name: bytes, change: bytes | None, at: int) -> bytes:
    out, place = b"", 0
    while place + 8 <= len(content):
        size, kind = struct.unpack_from(">I4s", content, place)
        body = content[place + 8 : place + size] if size >= 8 else content[place + 8 :]
        if kind == name and change is not None:
            body = change if not at else body[:at] + change + body[at + len(change) :]
        elif kind in CONTAINERS:
            body = _rebuilt(body, name, change, at)
        elif kind == b"stsd" and name == b"pasp":
            body = _with_pasp(body, change or b"")
        out += struct.pack(">I4s", 8 + len(body), kind) + body
        place += max(size, 8)
    return out


def _with_pasp(body: bytes, pasp: bytes) -> bytes:
    """The description of the images, with the aspect at its end."""
    entry = bytearray(body[8:])
    head, inner = entry[: 8 + 78], entry[8 + 78 :]
    inner = _without(bytes(inner), b"pasp") + struct.pack(">I4s", 16, b"pasp") + pasp
    head[:4] = struct.pack(">I", len(head) + len(inner))
    return body[:8] + bytes(head) + inner


def _without(content: bytes, name: bytes) -> bytes:
    out, place = b"", 0
    while place + 8 <= len(content):
        size, kind = struct.unpack_from(">I4s", content, place)
        out += b"" if kind == name else content[place : place + size]
        place += max(size, 8)
    return out
