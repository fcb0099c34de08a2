"""Frames stored for replay, in an unnamed temporary file that vanishes with this process, however that ends."""

from __future__ import annotations

import weakref
from collections import defaultdict
from tempfile import TemporaryFile
from threading import Lock
from typing import Any, BinaryIO

MB = 1_000_000


class StoredFrame:
    """A frame that States refer to: its content is stored as long as one of them exists. Pickled as its digest."""

    __slots__ = ("__weakref__", "digest", "offset", "size")

    def __init__(self, digest: bytes, offset: int = 0, size: int = 0) -> None:
        self.digest = digest
        self.offset = offset
        self.size = size
        """[bytes]; 0 where the content was not stored."""

    def __reduce__(self) -> tuple[Any, ...]:
        return (stored_frame, (self.digest,))


class FrameStore:
    """Stores contents by digest, each once. Safe from several threads."""

    def __init__(self) -> None:
        self._file: BinaryIO | None = None
        self._end = 0
        self._free: defaultdict[int, list[int]] = defaultdict(list)
        """By size, offsets of freed blocks."""
        self._stored: weakref.WeakValueDictionary[bytes, StoredFrame] = weakref.WeakValueDictionary()
        self._lock = Lock()

    @property
    def used_bytes(self) -> int:
        """Returns the size of the file without freed blocks."""
        return self._end - sum(size * len(offsets) for size, offsets in list(self._free.items()))

    def keep(self, digest: bytes, content: bytes, budget_mb: int) -> StoredFrame:
        """Stores the content, unless that exceeds the budget or the disk is full; returns a reference in any case."""
        with self._lock:
            if (stored := self._stored.get(digest)) is not None:
                return stored
            size = len(content)
            if self.used_bytes + size > budget_mb * MB:
                return StoredFrame(digest)
            offsets = self._free[size]
            offset = offsets.pop() if offsets else self._end
            try:
                self._write(offset, content)
            except OSError:
                if offset < self._end:
                    offsets.append(offset)
                return StoredFrame(digest)
            self._end = max(self._end, offset + size)
            new = self._stored[digest] = StoredFrame(digest, offset, size)
            weakref.finalize(new, offsets.append, offset).atexit = False
            return new

    def find(self, digest: bytes) -> StoredFrame:
        """Returns the reference with this digest; without content where that is gone."""
        return self._stored.get(digest) or StoredFrame(digest)

    def read(self, digest: bytes) -> bytes | None:
        """Returns the content; None where it was not stored."""
        stored = self._stored.get(digest)
        if stored is None or self._file is None:
            return None
        with self._lock:
            self._file.seek(stored.offset)
            return self._file.read(stored.size)

    def _write(self, offset: int, content: bytes) -> None:
        if self._file is None:
            self._file = TemporaryFile(prefix="ispom-replay-", buffering=0)  # type: ignore[assignment]  # noqa: SIM115
        self._file.seek(offset)
        written = 0
        while written < len(content):
            written += self._file.write(memoryview(content)[written:])


STORE = FrameStore()
"""The store of this process: a new estimator replays what others have received."""


def stored_frame(digest: bytes) -> StoredFrame:
    """Calls `FrameStore.find` of this process; a function of the module, as pickling requires."""
    return STORE.find(digest)
