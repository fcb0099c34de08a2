"""Numbers and terms as people read them, the same everywhere."""

from __future__ import annotations

import humanize

ALIGNMENTS = {
    "none": "none: coordinates are compared as they are",
    "first": "first: the first compared poses coincide",
    "scale": "scale: only the unit is fitted, over all compared poses",
    "se3": "se3: rotation and translation, no scale, fitted over all compared poses",
    "sim3": "sim3: rotation, translation and scale, fitted over all compared poses",
}
"""What each way to align a trajectory does."""
ROUNDING_M = 1e-9


def length(metres: float) -> str:
    """Three digits: 83.9 mm, 6.83 m; what is less than a nanometre is rounding."""
    return humanize.metric(metres, "m", precision=3) if abs(metres) >= ROUNDING_M else "0 mm"


def size(count: int) -> str:
    """Of bytes: 12.3 MB."""
    return humanize.naturalsize(count)


def duration(seconds: float) -> str:
    """Whole seconds: 45 s, 3 min 20 s."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"
