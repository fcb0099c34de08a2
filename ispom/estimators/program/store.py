"""Frames kept for replay, in a temporary file without a name that vanishes with the program, however that ends."""

from __future__ import annotations

import weakref
from collections import defaultdict
from tempfile import TemporaryFile
from threading import Lock
from typing import Any, BinaryIO

MB = 1_000_000


class Kept:
    """A frame that States refer to: its content is kept as long as one of them is. Pickled as its digest."""

    __slots__ = ("__weakref__", "digest", "offset", "size")

    def __init__(self, digest: bytes, offset: int = 0, size: int = 0) -> None:
        self.digest = digest
        self.offset = offset
        self.size = size
        """[bytes]; 0 where the content was not kept."""

    def __reduce__(self) -> tuple[Any, ...]:
        return (kept, (self.digest,))


class ExposureStore:
    """Contents by digest, each once. Safe from several threads."""

    def __init__(self) -> None:
        self._file: BinaryIO | None = None
        self._end = 0
        self._free: defaultdict[int, list[int]] = defaultdict(list)
        """By size, the places that are free again."""
        self._kept: weakref.WeakValueDictionary[bytes, Kept] = weakref.WeakValueDictionary()
        self._lock = Lock()

    @property
    def used_bytes(self) -> int:
        """Of the file, without what is free again."""
        return self._end - sum(size * len(places) for size, places in list(self._free.items()))

    def keep(self, digest: bytes, content: bytes, budget_mb: int) -> Kept:
        """Refers to the content, which is kept unless all then took more than the budget, or the disk is full."""
        with self._lock:
            if (found := self._kept.get(digest)) is not None:
                return found
            size = len(content)
            if self.used_bytes + size > budget_mb * MB:
                return Kept(digest)
            places = self._free[size]
            place = places.pop() if places else self._end
            try:
                self._write(place, content)
            except OSError:
                if place < self._end:
                    places.append(place)
                return Kept(digest)
            self._end = max(self._end, place + size)
            new = self._kept[digest] = Kept(digest, place, size)
            weakref.finalize(new, places.append, place).atexit = False
            return new

    def find(self, digest: bytes) -> Kept:
        """The one of this digest; without content where that is gone."""
        return self._kept.get(digest) or Kept(digest)

    def read(self, digest: bytes) -> bytes | None:
        """None where the content was not kept."""
        found = self._kept.get(digest)
        if found is None or self._file is None:
            return None
        with self._lock:
            self._file.seek(found.offset)
            return self._file.read(found.size)

    def _write(self, place: int, content: bytes) -> None:
        if self._file is None:
            self._file = TemporaryFile(prefix="ispom-replay-", buffering=0)  # type: ignore[assignment]  # noqa: SIM115
        assert self._file is not None
        self._file.seek(place)
        written = 0
        while written < len(content):
            written += self._file.write(memoryview(content)[written:])


STORE = ExposureStore()
"""Of this process: estimators that are built anew replay what others have seen."""


def kept(digest: bytes) -> Kept:
    """As `ExposureStore.find` in that of this process."""
    return STORE.find(digest)
