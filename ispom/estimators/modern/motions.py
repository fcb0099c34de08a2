"""When a second rigid motion is told of, beside that of the camera before a scene that stands still."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.types import Check, Decision

LEAST = 20
"""Points that one other motion has to explain: of fewer none is told."""
MOST_OF = 0.5
"""Share of those left unexplained that it has to explain: an essential matrix explains a third of any 30 points, and of
fewer up to 60 %."""
MARKED = 0.1
"""Share of all points from which a second motion is a thing of its own and no few tracks gone astray: with 200 points
the least that is told of at all."""
SECOND_MOTION = Check(
    "second_motion",
    "share of points that another motion explains",
    "warning",
    "Does anything else move?",
    "<",
    passes="One motion: no other one explains {threshold:.0%} of the points, or more ({value:.0%}).",
    fails="Two rigid motions: another one explains {value:.0%} of the points; what moves may be taken for the scene.",
)


def told(explained: NDArray[np.bool_], count: int) -> Decision:
    """Of `count` points in all, those (N,) that one motion leaves unexplained, and another one explains or not."""
    also = int(explained.sum())
    share = also / count if also >= max(LEAST, MOST_OF * len(explained)) else 0.0
    tracks = f"{also} of {count} tracks, {len(explained)} unexplained" if share else ""
    return SECOND_MOTION.of(share, MARKED, tracks)
