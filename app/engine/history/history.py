"""The frames of one run within a budget of memory: all in temporary files, and the newest in memory as well.

Each frame is written to disk once, when it comes, so that each takes the same time whether the budget is full or not.
What no longer fits into `memory_bytes` is then removed from memory, the oldest frame first. On disk, tracks, landmarks
and residuals take at most `disk_bytes`. Beyond that the oldest frames lose theirs, and keep poses, revisions, statuses
and decisions. The files have no name and vanish when the program ends, in whatever way. Images are read from the
sequence again.
"""

from __future__ import annotations

import logging
from array import array
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from tempfile import TemporaryFile
from threading import Lock
from typing import Protocol

from .encoding import decode, encode
from .record import ExposureRecord, size_bytes

log = logging.getLogger(__name__)
MEMORY_BYTES = 200_000_000
DISK_BYTES = 8_000_000_000
SEGMENTS = 16
"""Number of pieces of the disk's budget. When the budget is used up, the oldest piece is discarded."""


class Records(Protocol):
    def __len__(self) -> int: ...
    def __getitem__(self, index: int, /) -> ExposureRecord: ...


@dataclass(frozen=True, eq=False)
class Past:
    """The first `count` frames of another run, with the results of these methods."""

    records: Records
    count: int
    methods: tuple[str, ...]

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int, /) -> ExposureRecord:
        record = self.records[index]
        if record.statuses.keys() <= set(self.methods):
            return record
        steps = tuple(step for step in record.steps if step.method in self.methods)
        statuses = {m: status for m, status in record.statuses.items() if m in self.methods}
        return replace(record, steps=steps, statuses=statuses)


class History:
    """Records by index. One thread appends them, any thread reads them, as often as it wants."""

    def __init__(
        self,
        memory_bytes: int = MEMORY_BYTES,
        disk_bytes: int = DISK_BYTES,
        past: Past | None = None,
        ahead: Records = (),
    ) -> None:
        """`past`: the frames before the first one, whose records are not copied. `ahead`: the first frames of the same
        run as they were recorded; each is used until its own record is appended."""
        self._past, self._ahead = past, ahead
        self._memory_bytes, self._segment_bytes = memory_bytes, disk_bytes // SEGMENTS
        self._recent: deque[tuple[ExposureRecord, int]] = deque()
        """The newest records, with their sizes."""
        self.used_bytes = 0
        """Memory that the records take."""
        self._facts = _Blobs(len(past) if past is not None else 0)
        self._points: deque[_Blobs] = deque()
        self._refused = False
        """Whether something could not be written to disk."""
        self._lock = Lock()

    def __len__(self) -> int:
        """Returns the number of known frames, in memory, on disk, or recorded."""
        return max(self._facts.end, len(self._ahead))

    @property
    def computed(self) -> int:
        """Returns the number of frames without those that are known only from a recording."""
        return self._facts.end

    def __iter__(self) -> Iterator[ExposureRecord]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: int) -> ExposureRecord:
        """The record of a frame; IndexError beyond the last. Negative indices count from the end."""
        with self._lock:
            index = index if index >= 0 else len(self) + index
            first = self._facts.end - len(self._recent)
            if index >= self._facts.end:
                return self._ahead[index]
            if index >= first:
                return self._recent[index - first][0]
            if self._past is not None and index < self._facts.first:
                return self._past[index]
            facts = self._facts.read(index)
            points = next((blobs.read(index) for blobs in self._points if blobs.first <= index < blobs.end), None)
        return decode(facts, points)

    @property
    def last(self) -> ExposureRecord | None:
        """Returns the newest record that was computed; None without one."""
        return self._recent[-1][0] if self._recent else self[self.computed - 1] if self.computed else None

    def append(self, record: ExposureRecord) -> None:
        """Adds the next frame. Its record alone stays in memory whatever the budget."""
        size, (facts, points) = size_bytes(record), encode(record)
        with self._lock:
            self._store(record.index, facts, points)
            self._recent.append((record, size))
            self.used_bytes += size
            self._forget()

    def limit(self, memory_bytes: int) -> None:
        """Changes the budget of memory."""
        with self._lock:
            self._memory_bytes = memory_bytes
            self._forget()

    def _forget(self) -> None:
        """Removes records from memory until they fit; they stay on disk."""
        while self.used_bytes > self._memory_bytes and len(self._recent) > 1:
            self.used_bytes -= self._recent.popleft()[1]

    @property
    def in_memory(self) -> int:
        """How many of the newest frames are in memory."""
        return len(self._recent)

    @property
    def kept_points(self) -> int:
        """The first frame from which on all have their tracks and landmarks."""
        first = self._points[0].first if self._points else self._facts.end - len(self._recent)
        past = None if self._past is None else self._past.records
        return past.kept_points if isinstance(past, History) and first <= self._facts.first else first

    def _store(self, index: int, facts: bytes, points: bytes) -> None:
        if not self._points or self._points[-1].size + len(points) > self._segment_bytes:
            self._points.append(_Blobs(index))
            if len(self._points) > SEGMENTS:
                self._points.popleft()
        try:
            self._points[-1].append(points)
        except OSError as fault:
            if not self._refused:
                log.warning("the history keeps older frames without their tracks: %s", fault.strerror)
            self._refused = True
            self._points.clear()
        try:
            self._facts.append(facts)
        except OSError:
            self._facts.keep(facts)


class _Blobs:
    """Byte strings in a temporary file, numbered from `first` on."""

    def __init__(self, first: int) -> None:
        self.first, self.size = first, 0
        self._starts = array("q")
        self._file = None
        self._blobs: dict[int, bytes] = {}
        """Byte strings that could not be written to disk."""

    @property
    def end(self) -> int:
        return self.first + len(self._starts)

    def append(self, blob: bytes) -> None:
        """Writes the next byte string. OSError where it cannot be written."""
        if self._file is None:
            self._file = TemporaryFile(prefix="ispom-history-")  # noqa: SIM115 (closed with the last that reads it)
        self._file.seek(self.size)
        self._file.write(blob)
        self._file.flush()
        self._starts.append(self.size)
        self.size += len(blob)

    def keep(self, blob: bytes) -> None:
        """Keeps it in memory."""
        self._blobs[self.end] = blob
        self._starts.append(self.size)

    def read(self, number: int) -> bytes:
        if number in self._blobs or self._file is None:
            return self._blobs[number]
        at = number - self.first
        start = self._starts[at]
        stop = self._starts[at + 1] if at + 1 < len(self._starts) else self.size
        self._file.seek(start)
        return self._file.read(stop - start)


@dataclass(frozen=True)
class HistoryUsage:
    """Memory and states of one run. All its frames are on disk, with poses, statuses and checks."""

    in_memory: int = 0
    """The newest frames that are in memory as well."""
    exposures_bytes: int = 0
    """Memory that they take."""
    points_from: int = 0
    """The first frame that still has its tracks, landmarks and residuals."""
    states: int = 0
    """Number of stored states to fork from; other states are reached by replay."""
    states_bytes: int = 0
    """Memory that they take."""
    interval: int = 0
    """Frames from one such state to the next."""

    @property
    def sentence(self) -> str:
        """Describes the memory in use; empty where there is none."""
        if not self.interval:
            return ""
        newest = f"the newest {self.in_memory} in memory ({_mb(self.exposures_bytes)})"
        tracks = f"tracks from frame {self.points_from} on" if self.points_from else "tracks of all frames"
        return (
            f"Held: all frames on disk, {newest}; {tracks}; "
            f"{self.states} states to fork from, one in {self.interval} frames ({_mb(self.states_bytes)})."
        )


def _mb(size_bytes: int) -> str:
    return f"{size_bytes / 1e6:.0f} MB"
