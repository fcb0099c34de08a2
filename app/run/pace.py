"""How long something that is done by and by is still going to take, told from how its share has grown."""

from __future__ import annotations

from dataclasses import dataclass, replace

EXPECTED_S = 30.0
"""What all of the compilation takes on a usual machine."""
EXPECTED_SHARE = 0.15
"""What has been seen counts as much as the expectation when this share of all is done."""
LEAST_S = 1.0
"""Said to be left where more time has passed than was expected."""


@dataclass(frozen=True)
class Pace:
    """Shares done, 0..1, and when they were first seen [s, of any clock]."""

    begun_s: float | None = None
    """When the first part was done: what is loaded before it takes long where the disk or the processor is busy, and
    tells nothing of what follows."""
    changed_s: float = 0.0
    share: float = 0.0

    def after(self, now_s: float, share: float) -> Pace:
        if share <= self.share:
            return self
        begun_s = now_s if self.begun_s is None else self.begun_s
        return replace(self, begun_s=begun_s, changed_s=now_s, share=share)

    def left_s(self, now_s: float) -> float | None:
        """None before anything is done; never more than a moment before unless a part has been done meanwhile."""
        if self.begun_s is None:
            return None
        took = self.changed_s - self.begun_s + EXPECTED_SHARE * EXPECTED_S
        left = (1 - self.share) * took / (self.share + EXPECTED_SHARE)
        return max(left - (now_s - self.changed_s), LEAST_S)
