"""Prefetching: one background thread reads the next frames while the estimators process the current one."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from threading import Lock

from ispom.types import Measurement, Sequence

MAX_DECODED = 4
"""Largest number of frames that are decoded in advance."""


def prefetched(sequence: Sequence) -> Sequence:
    """Returns the sequence with prefetching from the last frame of `prepare` on; one that prefetches itself, or is
    live, is returned unchanged.

    The thread ends with the sequence or the process. Frames that were not prefetched are read by the caller's thread.
    """
    if sequence.prepare is not None or sequence.grow is not None:
        return sequence
    ahead = _Ahead(sequence.load, len(sequence))
    return replace(sequence, load=ahead.load, prepare=ahead.prepare)


class _Ahead:
    """Reads frames 0..count-1, the next MAX_DECODED of them in the background. Can be used from several threads."""

    def __init__(self, load: Callable[[int], Measurement], count: int) -> None:
        self._load, self._count = load, count
        self._lock = Lock()
        self._pool = ThreadPoolExecutor(1, "read-ahead")
        self._pending: dict[int, Future[Measurement]] = {}

    def prepare(self, i: int) -> None:
        """Restarts prefetching at frame i."""
        with self._lock:
            self._forget_before(self._count)
            self._fill(i)

    def load(self, i: int) -> Measurement:
        with self._lock:
            pending = self._pending.pop(i, None)
            if pending is not None:
                self._forget_before(i)
                self._fill(i + 1)
        return self._load(i) if pending is None else pending.result()

    def _fill(self, i: int) -> None:
        for j in range(i, min(i + MAX_DECODED, self._count)):
            if j not in self._pending:
                try:
                    self._pending[j] = self._pool.submit(self._load, j)
                except RuntimeError:  # the process ends: frames that are still needed are read by the caller
                    return

    def _forget_before(self, i: int) -> None:
        for j in [j for j in self._pending if j < i]:
            self._pending.pop(j).cancel()
