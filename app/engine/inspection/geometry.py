"""Lines that show the geometry in the scene: the current triple (Figs 3 and 4), the current pair (Figs 5 and 6), and
the rays of the selected track."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.solvers.multiview.triangulation import points_from_disparity
from ispom.types import TrackStatus

from ..history.quantities import by_method
from ..model.run_model import RunModel
from .covisibility import key_frames
from .looked import Looked, pose_at
from .sightings import Seen, TrackLife, camera_pose, seen_by

MOST_POINTS = 16
"""Most points whose rays are drawn: more would hide each other."""


@dataclass(frozen=True, eq=False)
class Rays:
    """Camera centres and points that all of them see, in the world of a method."""

    method: str
    indices: tuple[int, ...]
    """Frames of the cameras."""
    centres: Array
    """(C, 3) camera centres, in the order of `indices`."""
    points: Array
    """(P, 3); each camera sees each of them."""

    @property
    def between(self) -> Array:
        """(B, 2, 3) from each camera to each later one: T12, T13 and T23 of a triple, the baseline of a pair."""
        first, second = np.triu_indices(len(self.centres), 1)
        return np.stack([self.centres[first], self.centres[second]], 1)

    @property
    def lengths(self) -> Array:
        """(B,) of `between`."""
        return np.linalg.norm(self.between[:, 1] - self.between[:, 0], axis=1)

    def parallax_deg(self) -> Array:
        """Returns (P,) the angle between the rays from each point to the first and the last camera."""
        first, last = (self.points - self.centres[i] for i in (0, -1))
        return np.degrees(np.arctan2(np.linalg.norm(np.cross(first, last), axis=1), (first * last).sum(1)))

    @property
    def to_points(self) -> Array:
        """(C * P, 2, 3) from each camera to each point."""
        count = len(self.centres), len(self.points)
        return np.stack([np.repeat(self.centres, count[1], 0), np.tile(self.points, (count[0], 1))], 1)


def triple(looked: Looked, model: RunModel) -> Rays | None:
    """The last three keyframes of the video camera and points that all of them saw; None before there are three with a
    pose."""
    method = next((m for m in model.methods if _follows(looked, m, "video")), None)
    if method is None:
        return None
    keys = key_frames(looked.series, method, looked.record.index)[-3:]
    views = [seen_by(looked.records[i], method, "video") for i in keys]
    seen = [view for view in views if view is not None]
    poses = [pose_at(model, method, view.step.time_ns, looked.rig, "video") for view in seen]
    known = [pose for pose in poses if pose is not None]
    if len(known) < 3:
        return None
    return Rays(method, tuple(keys), np.stack([pose.translation for pose in known]), _points(seen))


def pair(looked: Looked) -> Rays | None:
    """The latest stereo frame with a pose: both cameras, and points by their disparity; None without one."""
    found = next(_pairs(looked), None)
    if found is None:
        return None
    seen, world_from_left = found
    rig, tracks = looked.rig, seen.tracks
    usable = np.flatnonzero((tracks.disparity_px > 0) & (tracks.status < TrackStatus.LOST))
    usable = usable[_spread(len(usable))]
    xyz = points_from_disparity(rig.camera("left"), rig.baseline_m, tracks.uv[usable], tracks.disparity_px[usable])
    right = world_from_left.apply(np.array([rig.baseline_m, 0.0, 0.0]))
    centres = np.stack([world_from_left.translation, right])
    return Rays(seen.step.method, (seen.index,), centres, world_from_left.apply(xyz))


def track_rays(life: TrackLife, xyz_in_world: Array) -> Rays:
    """From the cameras that saw the track to its point."""
    views = [(s.index, s.world_from_camera.translation) for s in life.seen if s.world_from_camera is not None]
    centres = np.array([centre for _, centre in views]).reshape(-1, 3)
    return Rays(life.method, tuple(index for index, _ in views), centres, xyz_in_world[None])


def _follows(looked: Looked, method: str, camera: str) -> bool:
    """Whether the method itself follows tracks in the camera, by its latest step of the camera's kind."""
    kind = "stereo" if camera == "left" else "video"
    kinds, now = looked.sequence.kinds, looked.record.index
    index = next((i for i in range(now, -1, -1) if kinds[i] == kind), None)
    step = by_method(looked.records[index].steps).get(method) if index is not None else None
    return step is not None and camera in step.tracks


def _pairs(looked: Looked) -> Iterator[tuple[Seen, Pose]]:
    """Yields the pairs of the last 60 frames up to the one shown, newest first, with their poses as given then."""
    for index in range(looked.record.index, max(looked.record.index - 60, -1), -1):
        seen = seen_by(looked.records[index], camera="left")
        pose = camera_pose(seen.step, looked.rig, "left") if seen is not None else None
        if seen is not None and pose is not None and looked.rig.has_stereo:
            yield seen, pose


def _points(views: list[Seen]) -> Array:
    """Returns positions (P, 3) of the points that all of these views saw, by the last view that has any of them."""
    ids = views[0].tracks.ids
    for view in views:
        ids = np.intersect1d(ids, view.tracks.ids[view.tracks.status < TrackStatus.LOST])
    for view in reversed(views):
        points = view.step.landmarks
        xyz = points.xyz_in_world[np.isin(points.ids, ids)]
        xyz = xyz[np.isfinite(xyz).all(1)]
        if len(xyz):
            return xyz[_spread(len(xyz))]
    return np.zeros((0, 3))


def _spread(count: int) -> NDArray[np.int64]:
    """Returns up to MOST_POINTS indices, spread evenly over `count` points."""
    return np.unique(np.linspace(0, max(count - 1, 0), min(MOST_POINTS, count)).astype(int))
