"""The interval between a camera's frames, by its last few time stamps."""

from __future__ import annotations

from dataclasses import dataclass

REMEMBERED = 15
"""Intervals: one bad time stamp, or some frames that are missing, change nothing."""


@dataclass(frozen=True)
class FrameInterval:
    last_ns: int | None = None
    recent_ns: tuple[int, ...] = ()

    def after(self, time_ns: int) -> FrameInterval:
        """Returns the interval updated by one more frame."""
        if self.last_ns is None or time_ns <= self.last_ns:
            return FrameInterval(time_ns, self.recent_ns)
        return FrameInterval(time_ns, (*self.recent_ns, time_ns - self.last_ns)[-REMEMBERED:])

    @property
    def median_ns(self) -> int | None:
        """None before a second frame."""
        return sorted(self.recent_ns)[len(self.recent_ns) // 2] if self.recent_ns else None
