"""Decoding ahead: one background thread reads the next frames while the estimators work on this one."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from threading import Lock

from ispom.types import Measurement, Sequence

AHEAD = 4
"""Frames that are kept decoded at most."""


def prefetched(sequence: Sequence) -> Sequence:
    """The same sequence, read ahead from where `prepare` started last; one that prepares by itself, or is live, stays
    as it is.

    The thread ends with the sequence or the process. Frames out of turn are read by whoever asks for them.
    """
    if sequence.prepare is not None or sequence.grow is not None:
        return sequence
    ahead = _Ahead(sequence.load, len(sequence))
    return replace(sequence, load=ahead.load, prepare=ahead.prepare)


class _Ahead:
    """Reads frames 0..count-1, the next AHEAD of them in the background. Safe from several threads."""

    def __init__(self, load: Callable[[int], Measurement], count: int) -> None:
        self._load, self._count = load, count
        self._lock = Lock()
        self._pool = ThreadPoolExecutor(1, "read-ahead")
        self._pending: dict[int, Future[Measurement]] = {}

    def prepare(self, i: int) -> None:
        """Starts again with frame i."""
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
        for j in range(i, min(i + AHEAD, self._count)):
            if j not in self._pending:
                try:
                    self._pending[j] = self._pool.submit(self._load, j)
                except RuntimeError:  # the process ends: whoever still wants a frame reads it
                    return

    def _forget_before(self, i: int) -> None:
        for j in [j for j in self._pending if j < i]:
            self._pending.pop(j).cancel()
