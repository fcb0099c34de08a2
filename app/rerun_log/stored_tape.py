"""The bytes of a finished recording for the viewers in browsers, read from its file as they ask for them."""

from __future__ import annotations

import threading
from array import array
from pathlib import Path
from uuid import uuid4

from ispom.errors import InputError

from .rrd import message_starts, require_readable
from .tape import Tape


class StoredTape:
    """Reads as a Tape does; each item is a message of the file."""

    def __init__(self, path: Path) -> None:
        """InputError where the file is no finished recording of this version."""
        self.run = uuid4().hex
        require_readable(path)
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise InputError(f"{path} cannot be read ({error.strerror}): check its permissions") from None
        self._lock = threading.Lock()
        self._starts = array("q", (at for at, _ in message_starts(self._file)))
        """Where each message begins, and where the last one ends."""

    def read(self, first: int, most_bytes: int) -> tuple[bytes, int]:
        """Messages from `first` on, at least one where there is one, and the number of the next one."""
        with self._lock:
            last = len(self._starts) - 1
            if self._file.closed or first >= last:
                return b"", first
            after = first + 1
            while after < last and self._starts[after] - self._starts[first] < most_bytes:
                after += 1
            self._file.seek(self._starts[first])
            return self._file.read(self._starts[after] - self._starts[first]), after

    def close(self) -> None:
        """It reads as empty from now on."""
        with self._lock:
            self._file.close()


AnyTape = Tape | StoredTape
