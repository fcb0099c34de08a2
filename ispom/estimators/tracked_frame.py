"""The tracks of a single camera in one frame, and their scene points, for all monocular methods."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.geometry import Array, Pose
from ispom.numerics.places import common, places
from ispom.solvers.multiview.rotation import dominant_rotation, median_displacement

MOST_SHOWN_PX = 1e4
"""A point just behind the camera has no bound to its error."""
MIN_COMMON = 8
"""Least number of common points for a parallax of two frames: a median of fewer may be that of outliers."""


@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """The tracked points of one frame, and its pose once it has one."""

    time_ns: int
    ids: NDArray[np.int64]
    """(N,) ascending."""
    x: Array
    """(N, 2) normalised coordinates."""
    world_from_camera: Pose | None = None

    @property
    def pose(self) -> Pose:
        """Returns world_from_camera. Raises ValueError for a frame that was not localised."""
        return required(self.world_from_camera, "the frame was not localised")

    def at(self, ids: NDArray[np.int64]) -> Array:
        """Normalised coordinates (M, 2) of points (M,) that this frame has."""
        return self.x[np.searchsorted(self.ids, ids)]

    def common(self, other: TrackedFrame) -> int:
        """Returns the number of points that both frames have."""
        return len(common(self.ids, other.ids)[0])

    def without(self, ids: NDArray[np.int64]) -> TrackedFrame:
        """Without some of its points (M,), ascending."""
        if not len(ids):
            return self
        kept = places(ids, self.ids) < 0
        return self if kept.all() else replace(self, ids=self.ids[kept], x=self.x[kept])

    def with_updated_coordinates(self, ids: NDArray[np.int64], x: Array) -> TrackedFrame:
        """Returns the frame with new coordinates (M, 2) of the points (M,); points that it does not have are
        skipped."""
        place, moved = places(self.ids, ids), self.x.copy()
        moved[place[place >= 0]] = x[place >= 0]
        return replace(self, x=moved)

    def with_new(self, ids: NDArray[np.int64], x: Array) -> TrackedFrame:
        """Returns the frame with new points `ids` (M,) at `x` (M, 2); their ids are larger than all others."""
        return replace(self, ids=np.concatenate([self.ids, ids]), x=np.concatenate([self.x, x]))


@dataclass(frozen=True, eq=False)
class ScenePoints:
    """Points of the scene by track id."""

    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(M,) ascending."""
    xyz: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(M, 3) in the world, own unit."""

    def places(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """Index (K,) of each id, -1 where there is no such point."""
        return places(self.ids, ids)

    def count(self, ids: NDArray[np.int64]) -> int:
        """Returns how many of the ids (K,) are points."""
        return int(np.count_nonzero(self.places(ids) >= 0))

    def merged(self, newer: ScenePoints) -> ScenePoints:
        """Returns the points of both; a point in both has its newer position."""
        kept = ~np.isin(self.ids, newer.ids)
        ids, xyz = np.concatenate([self.ids[kept], newer.ids]), np.concatenate([self.xyz[kept], newer.xyz])
        order = np.argsort(ids)
        return ScenePoints(ids[order], xyz[order])

    def only(self, ids: NDArray[np.int64]) -> ScenePoints:
        kept = np.isin(self.ids, ids)
        return ScenePoints(self.ids[kept], self.xyz[kept])

    def without(self, ids: NDArray[np.int64]) -> ScenePoints:
        kept = ~np.isin(self.ids, ids)
        return ScenePoints(self.ids[kept], self.xyz[kept])


def parallax_deg(key: TrackedFrame, frame: TrackedFrame, scale: float) -> float:
    """Median displacement of the common points between two frames, the rotation taken away; 0 for too few of them.

    The rotation is that of their poses where both have one, else the one that explains most of the motion.
    `scale`: width of the robust loss of that fit, normalised.
    """
    in_key, in_frame = common(key.ids, frame.ids)
    if len(in_key) < MIN_COMMON:
        return 0.0
    x1, x2 = key.x[in_key], frame.x[in_frame]
    if key.world_from_camera is not None and frame.world_from_camera is not None:
        rotation = frame.world_from_camera.rotation.T @ key.world_from_camera.rotation
    else:
        rotation = dominant_rotation(x1, x2, scale)
    return float(np.degrees(np.arctan(median_displacement(rotation, x1, x2))))
