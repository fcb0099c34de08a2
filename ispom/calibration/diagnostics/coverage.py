"""What of the image and of the board's poses has been filmed, and what to film next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.types import Camera

COLUMNS, ROWS = 8, 6
ENOUGH = 3
"""Views with a point in a cell."""
TILT_DEG, TILTED_VIEWS = 20.0, 4
"""At least so many views should be tilted by this much, about each of both axes."""
DEPTH_RATIO = 1.5
"""The farthest view should be so many times as far away as the nearest."""
MANY_VIEWS = 15
_VERTICAL = ("top", "middle", "bottom")
_HORIZONTAL = ("left", "centre", "right")


@dataclass(frozen=True, eq=False)
class Coverage:
    """Of one camera's accepted views."""

    counts: NDArray[np.int64]
    """(ROWS, COLUMNS) views with a point in this cell of the image."""
    tilts_deg: Array
    """(V, 2) of the board about the image's horizontal and vertical axes."""
    distances_m: Array
    """(V,) of the board's points on the average."""
    advice: tuple[str, ...]
    """What to film next, in the order of importance; empty where nothing is missing."""

    @property
    def covered(self) -> float:
        """Share of the image's cells with ENOUGH views."""
        return float((self.counts >= ENOUGH).mean())


def coverage(
    camera: Camera, uv_of_views: list[Array], camera_from_board: list[Pose], centre_in_board: Array
) -> Coverage:
    """Of views by their points (N, 2) [px] and poses; `centre_in_board` (3,) is the middle of the board."""
    counts = np.zeros((ROWS, COLUMNS), np.int64)
    for uv in uv_of_views:
        column = (uv[:, 0] * COLUMNS / camera.width).astype(int).clip(0, COLUMNS - 1)
        row = (uv[:, 1] * ROWS / camera.height).astype(int).clip(0, ROWS - 1)
        counts[tuple(np.unique(np.stack([row, column]), axis=1))] += 1
    normals = np.array([pose.rotation[:, 2] for pose in camera_from_board]).reshape(-1, 3)
    tilts = np.degrees(np.arctan2(normals[:, [1, 0]], np.abs(normals[:, [2]])))
    distances = np.array([np.linalg.norm(pose.apply(centre_in_board)) for pose in camera_from_board])
    return Coverage(counts, tilts, distances, _advice(counts, tilts, distances))


def _advice(counts: NDArray[np.int64], tilts_deg: Array, distances_m: Array) -> tuple[str, ...]:
    out = []
    for axis, name in ((0, "backwards and forwards"), (1, "to the left and right")):
        for sign in (1, -1):
            if (sign * tilts_deg[:, axis] > TILT_DEG).sum() < TILTED_VIEWS / 2:
                out.append(f"tilt the board more {name}: by 30 to 45 degrees in several views")
                break
    bare = _bare_regions(counts)
    if bare:
        out.append(f"hold the board at the {', '.join(bare)} of the image, up to the border")
    if len(distances_m) and distances_m.max() < DEPTH_RATIO * distances_m.min():
        out.append("film the board from nearer and from farther away")
    if len(distances_m) < MANY_VIEWS:
        out.append(f"take more views: {len(distances_m)} are used, {MANY_VIEWS} to 40 are better")
    return tuple(out)


def _bare_regions(counts: NDArray[np.int64]) -> list[str]:
    """Of the image's nine regions those with less than half of their cells covered."""
    out = []
    for i, rows in enumerate(np.array_split(counts >= ENOUGH, 3)):
        for j, cells in enumerate(np.array_split(rows, 3, axis=1)):
            if cells.mean() < 0.5:
                out.append(f"{_VERTICAL[i]} {_HORIZONTAL[j]}")
    return out
