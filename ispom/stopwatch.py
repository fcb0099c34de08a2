"""Wall time per stage of one step, and CPU time."""

from __future__ import annotations

import time

_FINE = time.get_clock_info("process_time").resolution < 1e-4
cpu_clock = time.process_time if _FINE else time.perf_counter
"""Seconds of all threads of this process: what other programs do meanwhile hardly counts. (Where the system's count is
too coarse: wall time.)"""


class Stopwatch:
    """`lap("track")` books the time since the last lap under that name."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now
