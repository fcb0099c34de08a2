"""First values from two courses alone: by how much the clocks differ, and how the one camera is turned on the other.

Whatever sits on a rig turns alike: between two instants, the rotation vectors of both cameras are the same but for the
turn between them (Park & Martin 1994). So the offset is the one at which a single turn explains them best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.calibration.motion.course import Course
from ispom.geometry import Array, so3_log

STEP_S = 0.01
"""From one offset that is tried to the next."""
LEAST_PAIRS = 6
"""Intervals between two poses that both cameras must have seen."""
LEAST_SHARE = 0.5
"""Of the intervals that the best offset of all is tried on: one must be tried on so many to count."""
UNEXPLAINED = 0.5
"""Where so much of the turns (as a share of their mean square) is not explained, the cameras did not turn together,"""
STILL_RAD = np.radians(0.1)
"""unless they hardly turned at all: root mean square from one pose to the next."""


@dataclass(frozen=True, eq=False)
class Start:
    """What courses of a stereo pair's left camera and of a video camera say about each other."""

    offset_s: float
    """The video's time stamps are to be increased by it."""
    left_from_video: Array
    """(3, 3) rotation."""
    unexplained: float
    """Share of the turns' mean square that is left."""
    turned_rad: float
    """Root mean square of the turns from one stereo pose to the next."""

    @property
    def together(self) -> bool:
        """Whether these may be cameras on one rig, filming at the same time."""
        return self.unexplained < UNEXPLAINED or self.turned_rad < STILL_RAD


def start_of(left: Course, video: Course, most_s: float, middle_s: float = 0.0) -> Start | None:
    """For offsets within `most_s` of `middle_s`; None where the courses share too little at all of them."""
    offsets = middle_s + STEP_S * np.arange(-np.floor(most_s / STEP_S), np.floor(most_s / STEP_S) + 1)
    tried = [_tried(left, video, float(offset)) for offset in offsets]
    most = max((count for count, *_ in tried), default=0)
    good = [k for k, (count, *_) in enumerate(tried) if count >= max(LEAST_PAIRS, LEAST_SHARE * most)]
    if not good:
        return None
    best = min(good, key=lambda k: (tried[k][1], abs(offsets[k] - middle_s)))
    _, share, rotation, turned = tried[best]
    return Start(float(offsets[best]), rotation, share, turned)


def _tried(left: Course, video: Course, offset_s: float) -> tuple[int, float, Array, float]:
    """Intervals compared, unexplained share, best rotation, and size of the turns."""
    seen = video.at(left.times_s - offset_s)
    good = seen.known[:-1] & seen.known[1:]
    count = int(good.sum())
    if count < LEAST_PAIRS:
        return count, np.inf, np.eye(3), 0.0
    a = so3_log(np.swapaxes(left.rotations[:-1], 1, 2)[good] @ left.rotations[1:][good])
    b = so3_log(np.swapaxes(seen.rotations[:-1], 1, 2)[good] @ seen.rotations[1:][good])
    u, _, vt = np.linalg.svd(a.T @ b)
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    squares = float((a**2).sum())
    away = float(((a - b @ rotation.T) ** 2).sum())
    return count, away / max(squares, 1e-18), rotation, float(np.sqrt(squares / count))
