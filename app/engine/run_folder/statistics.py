"""Statistics that are collected during a run."""

from __future__ import annotations

import hashlib
from array import array
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ispom.types import Measurement, Status, Step, images_of

from ..events import Stepped
from ..verdict import missing


@dataclass
class ImagesDigest:
    """SHA-256 of all that the estimators saw: the time, size and pixels of each image."""

    _sha256: Any = field(default_factory=hashlib.sha256)

    def add(self, seen: Measurement) -> None:
        for image in images_of(seen).values():
            self._sha256.update(f"{seen.time_ns} {image.shape}\n".encode())
            self._sha256.update(np.ascontiguousarray(image))

    def hexdigest(self) -> str:
        return self._sha256.hexdigest()


@dataclass
class RunStatistics:
    """The statistics of a run. It grows by 4 bytes for each frame and method: 20,000 frames of three methods take
    240 kB."""

    ms: dict[str, array[float]] = field(default_factory=dict)
    """By method: the time for each frame [ms]."""
    cpu_ms: array[float] = field(default_factory=lambda: array("f"))
    """CPU time of all methods together for each frame that they use [ms]; empty where it was not measured."""
    peak_mb: float | None = None
    """Peak of the process's resident memory; None where it was not measured."""
    lost: dict[str, int] = field(default_factory=dict)
    located: dict[str, int] = field(default_factory=dict)
    starts: dict[str, list[tuple[int, int]]] = field(default_factory=dict)
    """By method: for each segment its first time [ns], and the number of the first segment with its world and unit.
    Segments in which the method is never located are included."""
    skipped: list[str] = field(default_factory=list)
    """Why each skipped frame was skipped. A run ends when more than one in a hundred is skipped."""
    waits: dict[str, str] = field(default_factory=dict)
    """For each method that was never located: the sentence of the check that failed last."""
    images: ImagesDigest = field(default_factory=ImagesDigest)

    def add(self, event: Stepped) -> None:
        self.images.add(event.exposure)
        self.skipped += [event.skipped] if event.skipped else []
        for step in event.steps:
            self.add_step(step, 1000 * sum(step.seconds.values()))

    def add_step(self, step: Step, ms: float) -> None:
        """Counts one step of a method, and the milliseconds that it took."""
        if not self.located.get(step.method) and step.status != Status.TRACKING and (why := missing(step)):
            self.waits[step.method] = why
        self.count(step.method, step.time_ns, ms, step.status, step.restarted, step.joins, step.segment_age_ns)

    def count(
        self,
        method: str,
        time_ns: int,
        ms: float,
        status: str,
        restarted: bool,
        joins: int | None = None,
        segment_age_ns: int = 0,
    ) -> None:
        """One frame of one method."""
        self.ms.setdefault(method, array("f")).append(ms)
        self.lost[method] = self.lost.get(method, 0) + (status == Status.LOST)
        self.located[method] = self.located.get(method, 0) + (status == Status.TRACKING)
        starts = self.starts.setdefault(method, [(time_ns, 0)])
        if restarted and time_ns - segment_age_ns > starts[-1][0]:
            starts.append((time_ns - segment_age_ns, len(starts)))
        if joins is not None and 0 <= joins < len(starts):
            own, earlier = starts[-1][1], starts[joins][1]
            self.starts[method] = [(t, earlier if world == own else world) for t, world in starts]

    def segments(self, method: str) -> list[tuple[int, int]]:
        """Returns the segments of a method, see `starts`; none where it was never located."""
        return self.starts.get(method, []) if self.located.get(method) else []

    def entry(self, method: str) -> dict[str, Any]:
        """As metrics.json has it."""
        ms = self.ms.get(method, array("f"))
        located, lost = self.located.get(method, 0), self.lost.get(method, 0)
        counts: dict[str, Any] = {"frames": len(ms), "located": located, "lost": lost}
        if not counts["located"] and method in self.waits:
            counts["never_located"] = self.waits[method]
        return {**counts, "ms_per_exposure": _spread(ms)}

    def resources(self) -> dict[str, Any]:
        """CPU time and memory of the whole run, as metrics.json has them; empty where they were not measured."""
        found: dict[str, Any] = {"cpu_ms_per_exposure": _spread(self.cpu_ms)} if len(self.cpu_ms) else {}
        return found | ({} if self.peak_mb is None else {"peak_memory_mb": self.peak_mb})


def _spread(ms: array[float]) -> dict[str, float | None]:
    median, p95 = np.percentile(ms, [50, 95]).tolist() if len(ms) else (None, None)
    return {"median": median, "p95": p95}
