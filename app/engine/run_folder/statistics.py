"""What is counted while a run goes on."""

from __future__ import annotations

import hashlib
from array import array
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ispom.types import Status, StereoPair

from ..events import Stepped


@dataclass
class RunStatistics:
    """Grows by 4 bytes for each frame and method: 20,000 frames of three are 240 kB."""

    ms: dict[str, array[float]] = field(default_factory=dict)
    """By method: the time for each frame [ms]."""
    lost: dict[str, int] = field(default_factory=dict)
    located: dict[str, int] = field(default_factory=dict)
    starts: dict[str, list[tuple[int, int]]] = field(default_factory=dict)
    """By method, of each segment: where it begins [ns], and the number of the first one whose world and unit it has;
    segments in which it is never located included."""
    skipped: list[str] = field(default_factory=list)
    """What was wrong with each frame that was skipped; of a run that goes on at most one in a hundred."""
    images: Any = field(default_factory=hashlib.sha256)
    """SHA-256 of all that the estimators saw: the time, size and pixels of each image."""

    def add(self, event: Stepped) -> None:
        seen = event.exposure
        for image in (seen.left, seen.right) if isinstance(seen, StereoPair) else (seen.image,):
            self.images.update(f"{seen.time_ns} {image.shape}\n".encode())
            self.images.update(np.ascontiguousarray(image))
        self.skipped += [event.skipped] if event.skipped else []
        for step in event.steps:
            ms = 1000 * sum(step.seconds.values())
            self.count(step.method, step.time_ns, ms, step.status, step.restarted, step.joins)

    def count(
        self, method: str, time_ns: int, ms: float, status: str, restarted: bool, joins: int | None = None
    ) -> None:
        """One frame of one method."""
        self.ms.setdefault(method, array("f")).append(ms)
        self.lost[method] = self.lost.get(method, 0) + (status == Status.LOST)
        self.located[method] = self.located.get(method, 0) + (status == Status.TRACKING)
        starts = self.starts.setdefault(method, [(time_ns, 0)])
        if restarted and time_ns > starts[-1][0]:
            starts.append((time_ns, len(starts)))
        if joins is not None and 0 <= joins < len(starts):
            starts[-1] = (starts[-1][0], starts[joins][1])

    def segments(self, method: str) -> list[tuple[int, int]]:
        """See `starts`; none where it was never located, as held poses say nothing."""
        return self.starts.get(method, []) if self.located.get(method) else []

    def entry(self, method: str) -> dict[str, Any]:
        """As metrics.json has it."""
        ms = self.ms.get(method, [])
        median, p95 = np.percentile(ms, [50, 95]).tolist() if len(ms) else (None, None)
        counts = {"frames": len(ms), "located": self.located.get(method, 0), "lost": self.lost.get(method, 0)}
        return {**counts, "ms_per_exposure": {"median": median, "p95": p95}}
