"""Numbers as people read them, the same everywhere."""

from __future__ import annotations

import humanize


def length(metres: float) -> str:
    """Three digits: 83.9 mm, 6.83 m."""
    return humanize.metric(metres, "m", precision=3)


def size(count: int) -> str:
    """Of bytes: 12.3 MB."""
    return humanize.naturalsize(count)
