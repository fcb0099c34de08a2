"""The bytes of finished recordings for the viewers in browsers, read from their files as they ask for them."""

from __future__ import annotations

import threading
from array import array
from bisect import bisect_right
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

from ispom.errors import InputError

from .rrd import message_starts, require_readable
from .tape import Tape


class StoredTape:
    """Reads as a Tape does; each item is a message of a file. Files of one recording follow each other."""

    def __init__(self, *paths: Path) -> None:
        """InputError where a file is no finished recording of this version."""
        self.run = uuid4().hex
        self._lock = threading.Lock()
        self._files = [_opened(path) for path in paths]
        self._starts = [array("q", (at for at, _ in message_starts(file))) for file in self._files]
        """Of each file: where each message begins, and where the last one ends."""
        self._firsts = [sum(len(starts) - 1 for starts in self._starts[:n]) for n in range(len(paths))]
        """The number of each file's first message."""

    def read(self, first: int, most_bytes: int) -> tuple[bytes, int]:
        """Messages from `first` on, at least one where there is one, and the number of the next one."""
        with self._lock:
            number = bisect_right(self._firsts, first) - 1
            file, starts, before = self._files[number], self._starts[number], self._firsts[number]
            at, last = first - before, len(starts) - 1
            if file.closed or at >= last:
                return b"", first
            after = at + 1
            while after < last and starts[after] - starts[at] < most_bytes:
                after += 1
            file.seek(starts[at])
            return file.read(starts[after] - starts[at]), before + after

    def close(self) -> None:
        """It reads as empty from now on."""
        with self._lock:
            for file in self._files:
                file.close()


def _opened(path: Path) -> BinaryIO:
    require_readable(path)
    try:
        return path.open("rb")
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): check its permissions") from None


AnyTape = Tape | StoredTape
