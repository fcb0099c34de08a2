"""How long something that another process does by and by is still going to take.

How much work is left is told in seconds of a processor, from how the share that is done has grown with these: others
that want the processors, too, change nothing in that. How long it takes follows from how much of a processor the
process has been given of late.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

EXPECTED_S = 24.0
"""Of a processor: what all of the compilation takes on a usual machine."""
EXPECTED_SHARE = 0.15
"""What has been seen counts as much as the expectation when this share of all is done."""
END_SHARE = 0.07
"""What is still to be done after the last part, as a share of all parts: the end of the flight that calls them."""
LEAST_S = 0.5
"""Of a processor: said to be left where more was done than was expected."""
OF_LATE_S = 15.0
"""What was given before so long counts a third of what is given now."""
LEAST_GIVEN = 0.01


@dataclass(frozen=True)
class Pace:
    """What was seen of a process, from its start on."""

    seen_s: float
    """When it was looked at last [s, of any clock]."""
    spent_s: float = 0.0
    """What it had spent by then [s of a processor]."""
    late_s: float = 0.0
    """How long that has been, what is long ago counting less [s]."""
    late_spent_s: float = 0.0
    """What it has spent meanwhile, counted the same way [s of a processor]."""
    share: float = 0.0
    """Done, 0..1."""
    begun_at_s: float | None = None
    """What it had spent when the first part was done: loading modules before that tells nothing of what follows."""
    done_at_s: float = 0.0
    """What it had spent when the last part so far was done."""

    def after(self, now_s: float, spent_s: float, share: float) -> Pace:
        kept = math.exp((self.seen_s - now_s) / OF_LATE_S)
        late_s = kept * self.late_s + now_s - self.seen_s
        late_spent_s = kept * self.late_spent_s + spent_s - self.spent_s
        seen = replace(self, seen_s=now_s, spent_s=spent_s, late_s=late_s, late_spent_s=late_spent_s)
        if share <= self.share:
            return seen
        begun_at_s = spent_s if self.begun_at_s is None else self.begun_at_s
        return replace(seen, share=share, begun_at_s=begun_at_s, done_at_s=spent_s)

    @property
    def left_s(self) -> float | None:
        """Seconds; None before anything is done."""
        if self.begun_at_s is None:
            return None
        took_s = self.done_at_s - self.begun_at_s + EXPECTED_SHARE * EXPECTED_S
        left_s = (1 + END_SHARE - self.share) * took_s / (self.share + EXPECTED_SHARE)
        given = self.late_spent_s / self.late_s if self.late_s > 0 else 1.0
        return max(left_s - (self.spent_s - self.done_at_s), LEAST_S) / max(given, LEAST_GIVEN)
