"""When a second rigid motion is told of, beside that of the camera before a scene that stands still; and which of the
two is followed.

Images alone do not say which of two things stands still. What is known of both since the same time does: a thing that
moves by itself is mostly small beside what it moves before, and the one that was there before the other is believed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.types import Check, Decision

Follow = Literal["static", "largest"]
"""Of two rigid motions: that of what stands still, as far as can be told; or of what fills more of the image."""

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
    "share of points that a second rigid motion explains",
    "warning",
    "Does something else move?",
    "<",
    passes="One motion: a second one explains {value:.0%} of the points (limit {threshold:.0%}).",
    fails="Second motion: another rigid motion explains {value:.0%} of the points (limit {threshold:.0%}), so a moving "
    "object may be taken for the scene.",
    topic="motion",
)


def second_motion_decision(explained: NDArray[np.bool_], count: int) -> Decision:
    """Of `count` points in all, those (N,) that one motion leaves unexplained, and another one explains or not."""
    also = int(explained.sum())
    share = also / count if also >= max(LEAST, MOST_OF * len(explained)) else 0.0
    tracks = f"{also} of {count} tracks move with it" if share else ""
    return SECOND_MOTION.of(share, MARKED, tracks)


CLEARLY = 1.5
"""Times the room of what is followed, from which another motion's is that of what stands still."""
AS_OLD = 0.25
"""Share of its points as old as half of the other's, from which a motion did not come later: where both were there
together it is a half."""
CELLS = 8, 6
"""Of the image, across and down, by which areas are told: a cell counts once, however many corners it has."""
WIDER = Check(
    "other_wider",
    "extent of the other motion's points / of those followed",
    "trigger",
    "Which motion is the scene?",
    passes="Switched to the other motion: it is older, or its points extend {value} times as far ({threshold} needed).",
    fails="Same motion as before: the other one is newer, or its points extend only {value} times as far ({threshold} "
    "needed).",
)
LARGER = Check(
    "other_larger",
    "area in the image of the other motion / of the one followed",
    "trigger",
    "Which motion is the scene?",
    ">",
    passes="Switched to the other motion: it covers {value} times the image area (more than {threshold} needed).",
    fails="Same motion as before: the other one covers {value} times the image area (more than {threshold} needed).",
)


@dataclass(frozen=True, eq=False)
class Moving:
    """Points that one rigid motion explains."""

    ids: NDArray[np.int64]
    """(N,) of the tracks: later ones are larger."""
    uv: NDArray[np.float32]
    """(N, 2) [px] in the image."""
    xyz: Array
    """(N, 3) in the world, before the two motions were told apart; NaN where they have no place."""

    @property
    def room(self) -> float:
        """Diagonal of the box that has all but a tenth of its points on either side of each axis."""
        known = self.xyz[np.isfinite(self.xyz[:, 0])]
        return float(np.linalg.norm(np.ptp(np.percentile(known, (10, 90), axis=0), axis=0))) if len(known) else 0.0

    def came_after(self, other: Moving) -> bool:
        """Whether hardly any of its points is as old as half of the other's."""
        return bool(np.mean(self.ids <= np.median(other.ids)) < AS_OLD)

    def area(self, size: tuple[int, int]) -> int:
        """Cells of an image of that size (width, height) that have one of its points."""
        cells = np.clip((self.uv / size * CELLS).astype(np.int64), 0, np.array(CELLS) - 1)
        return len(np.unique(cells[:, 0] * CELLS[1] + cells[:, 1]))


MORE = 1.0
"""Times the area of what is followed, from which another motion has more: its tracks end in each image, and fewer show
it than were there."""


def preferred(follow: Follow, other: Moving, own: Moving, size: tuple[int, int]) -> Decision:
    """Whether to follow the other motion instead of the one that was followed; `size` of the image (width, height).

    What stands still was there before what only passes, however much of the image that fills. Of what was there
    together, it is what spans more room.
    """
    if follow == "largest":
        return LARGER.of(other.area(size) / max(own.area(size), 1), MORE)
    span = other.room / max(own.room, 1e-12)
    if other.came_after(own):
        return WIDER.of(span, CLEARLY, "it is newer", passed=False)
    if own.came_after(other):
        return WIDER.of(span, CLEARLY, "it is older", passed=True)
    return WIDER.of(span, CLEARLY)
