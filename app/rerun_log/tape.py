"""The bytes of one run for the viewers in browsers: kept on disk, read from any place at any pace."""

from __future__ import annotations

import tempfile
import threading
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

from platformdirs import user_cache_path

IMAGE_BYTES = 512 << 20
"""Images that are kept for browsers that come late; the oldest go first, all else stays."""


@dataclass(frozen=True)
class _Piece:
    """Where some bytes are."""

    file: BinaryIO
    offset: int
    size: int


class Tape:
    """Append-only. Its files have no name: they are gone when the process is, however it ends."""

    def __init__(self, folder: Path | None = None, image_bytes: int = IMAGE_BYTES) -> None:
        """OSError where `folder` (by default the user's cache) cannot be written."""
        self.run = uuid4().hex
        self._folder = folder or user_cache_path("ispom")
        self._folder.mkdir(parents=True, exist_ok=True)
        self._lock = threading.Lock()
        self._lasting = self._file()
        self._halves: deque[BinaryIO] = deque([self._file()], maxlen=2)
        self._half_bytes = image_bytes // 2
        self._items: list[tuple[_Piece, _Piece]] = []

    def append(self, lasting: bytes, images: bytes) -> None:
        """Adds an item: `.rrd` messages each. OSError where the disk is full."""
        with self._lock:
            if self._halves[-1].seek(0, 2) + len(images) > self._half_bytes:
                if len(self._halves) == 2:
                    self._halves[0].close()
                self._halves.append(self._file())
            self._items.append((_write(self._lasting, lasting), _write(self._halves[-1], images)))

    def read(self, first: int, most_bytes: int) -> tuple[bytes, int]:
        """Items from `first` on, at least one where there is one, and the number of the next one."""
        found: list[bytes] = []
        size, at = 0, first
        with self._lock:
            while at < len(self._items) and size < most_bytes:
                found += [_read(piece) for piece in self._items[at]]
                size, at = size + len(found[-2]) + len(found[-1]), at + 1
        return b"".join(found), at

    def close(self) -> None:
        """Gives its space on the disk back; it reads as empty from now on."""
        with self._lock:
            self._items.clear()
            for file in (self._lasting, *self._halves):
                file.close()

    def _file(self) -> BinaryIO:
        return tempfile.TemporaryFile(dir=self._folder, prefix="live-")  # type: ignore[return-value]


def _write(file: BinaryIO, content: bytes) -> _Piece:
    offset = file.seek(0, 2)
    file.write(content)
    file.flush()
    return _Piece(file, offset, len(content))


def _read(piece: _Piece) -> bytes:
    if piece.file.closed:
        return b""
    piece.file.seek(piece.offset)
    return piece.file.read(piece.size)
