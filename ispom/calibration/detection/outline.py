"""Corners of a black quadrilateral from its four edges: blur rounds a corner, and leaves the edges in place."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.geometry import Array
from ispom.types import Image

PROFILES = 14
"""Cuts across each edge,"""
FROM, TO = 0.06, 0.5
"""along this part of it, from the corner on: a lens bends the whole of it too much for a line,"""
REACH = 0.1
"""this far to each side, of the shorter side: within the tag's black border."""
STEP_PX = 0.5
"""Between samples of a cut."""
PEAK_PX = 2.0
"""How far around its steepest place an edge counts."""
ROUNDS = 3


def outlined(grey: Image, corners: Array) -> Array:
    """(4, 2) where lines through the edges of the quadrilateral near corners (4, 2) meet."""
    for _ in range(ROUNDS):
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
        reach = max(2.0, REACH * float(sides.min()))
        around = [(corners[i], corners[i - 1], corners[(i + 1) % 4]) for i in range(4)]
        corners = np.array([_meeting(_edge(grey, at, a, reach), _edge(grey, at, b, reach)) for at, a, b in around])
        if not np.isfinite(corners).all():
            return np.full((4, 2), -1.0)
    return corners


def _edge(grey: Image, start: Array, end: Array, reach: float) -> tuple[Array, Array]:
    """A point (2,) and the direction (2,) of the line between dark and light near the first half of start to end."""
    along = end - start
    normal = np.array([along[1], -along[0]]) / max(float(np.linalg.norm(along)), 1e-9)
    offsets = np.arange(-reach, reach + STEP_PX / 2, STEP_PX)
    feet = start + np.linspace(FROM, TO, PROFILES)[:, None] * along
    places = (feet[:, None] + offsets[:, None] * normal).astype(np.float32)
    cut = cv2.remap(grey, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    slope, between = np.abs(np.diff(cut.astype(float), axis=1)), (offsets[1:] + offsets[:-1]) / 2
    steepest = between[slope.argmax(axis=1)]
    weight = np.where(np.abs(between - steepest[:, None]) <= PEAK_PX, slope, 0)
    total = weight.sum(1)
    good = total > 0.3 * np.median(total)
    if good.sum() < 4:
        return np.full(2, np.nan), along
    points = feet[good] + (((weight * between).sum(1) / np.maximum(total, 1e-9))[good, None]) * normal
    vx, vy, x, y = np.ravel(cv2.fitLine(points.astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.01)).tolist()
    return np.array([x, y]), np.array([vx, vy])


def _meeting(one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """(2,) where two lines cross; not finite where they do not."""
    matrix = np.column_stack([one[1], -other[1]])
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) < 1e-6:
        return np.full(2, np.nan)
    return one[0] + np.linalg.solve(matrix, other[0] - one[0])[0] * one[1]
