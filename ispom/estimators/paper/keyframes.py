"""Key frames and what lies between them, as the monocular estimator keeps it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.numerics.places import places
from ispom.solvers.rotation import dominant_rotation, median_displacement
from ispom.solvers.triple import Triple

MOST_WAITING = 300
"""Frames after the last key frame whose poses may still change."""


@dataclass(frozen=True, eq=False)
class Frame:
    """The tracked points of one frame, and its pose once it has one."""

    time_ns: int
    ids: NDArray[np.int64]
    """(N,) ascending."""
    x: Array
    """(N, 2) normalised coordinates."""
    world_from_camera: Pose | None = None

    def at(self, ids: NDArray[np.int64]) -> Array:
        """Normalised coordinates (M, 2) of points (M,) that this frame has."""
        return self.x[np.searchsorted(self.ids, ids)]

    def without(self, ids: NDArray[np.int64]) -> Frame:
        """Without some of its points."""
        kept = ~np.isin(self.ids, ids)
        return self if kept.all() else replace(self, ids=self.ids[kept], x=self.x[kept])


@dataclass(frozen=True, eq=False)
class Points:
    """Scene points by track id."""

    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(M,) ascending."""
    xyz: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(M, 3) in the world, own unit."""

    def places(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """Index (K,) of each id, -1 where there is no such point."""
        return places(self.ids, ids)

    def merged(self, newer: Points) -> Points:
        """Both, the newer position where both have one."""
        kept = ~np.isin(self.ids, newer.ids)
        ids, xyz = np.concatenate([self.ids[kept], newer.ids]), np.concatenate([self.xyz[kept], newer.xyz])
        order = np.argsort(ids)
        return Points(ids[order], xyz[order])

    def only(self, ids: NDArray[np.int64]) -> Points:
        kept = np.isin(self.ids, ids)
        return Points(self.ids[kept], self.xyz[kept])


def common_points(keys: tuple[Frame, ...], frame: Frame) -> int:
    """How many points all these frames have."""
    ids = frame.ids
    for key in keys:
        ids = np.intersect1d(ids, key.ids, assume_unique=True)
    return len(ids)


def parallax_deg(key: Frame, frame: Frame, scale: float) -> float:
    """Median displacement of the common points between two frames, the rotation taken away.

    The rotation is that of their poses where both have one, else the one that explains most of the motion.
    """
    ids = np.intersect1d(key.ids, frame.ids, assume_unique=True)
    if len(ids) < 8:
        return 0.0
    x1, x2 = key.at(ids), frame.at(ids)
    if key.world_from_camera is not None and frame.world_from_camera is not None:
        rotation = frame.world_from_camera.rotation.T @ key.world_from_camera.rotation
    else:
        rotation = dominant_rotation(x1, x2, scale)
    return float(np.degrees(np.arctan(median_displacement(rotation, x1, x2))))


@dataclass(frozen=True, eq=False)
class Window:
    """The last key frames, all frames since the oldest of them, and the points that they see."""

    keys: tuple[Frame, ...] = ()
    frames: tuple[Frame, ...] = ()
    """In order of time, key frames included."""
    landmarks: Points = Points()
    base: Pose = Pose()
    """world_from_camera that the first key frame after a (new) start gets."""
    fresh: bool = True
    """No triple has been solved since the (new) start."""
    starts_ns: tuple[int, ...] = ()
    """When each start but the first was: poses before and after one have nothing but the last pose in common."""

    @property
    def final_until_ns(self) -> int | None:
        """Poses before this time will not change without bundle adjustment, hardly with it; None before a triple."""
        return self.keys[-2].time_ns if len(self.keys) >= 3 else None

    def poses(self) -> list[tuple[int, Pose]]:
        return [(f.time_ns, f.world_from_camera) for f in self.frames if f.world_from_camera is not None]

    def predicted(self) -> Pose | None:
        """world_from_camera of the next frame, at the velocity of the last two poses; None without a triple yet."""
        known = [f.world_from_camera for f in self.frames if f.world_from_camera is not None][-2:]
        if self.fresh or not known:
            return None
        return known[-1] @ known[0].inverse() @ known[-1]

    def with_frame(self, frame: Frame) -> Window:
        return replace(self, frames=(*self.frames, frame))

    def with_key(self, frame: Frame) -> Window:
        """A key frame without a triple: one of the first two after a (new) start."""
        if not self.keys:
            frame = replace(frame, world_from_camera=self.base)
        return replace(self, keys=(*self.keys, frame), frames=(*self.frames, frame))

    def with_triple(self, triple: Triple, ids: NDArray[np.int64], third: Frame, scale: float) -> Window:
        """Places key frames 2 and 3 and the points of a triple, in the world and at its scale."""
        world_from_first = self.keys[-2].world_from_camera
        assert world_from_first is not None
        second = world_from_first @ triple.second_from_first.inverse().scaled(scale)
        third = replace(third, world_from_camera=world_from_first @ triple.third_from_first.inverse().scaled(scale))
        window = self.revised({self.keys[-1].time_ns: second})
        good = triple.resected
        points = Points(ids[good], world_from_first.apply(scale * triple.xyz_in_first[good]))
        return replace(
            window,
            keys=(*window.keys, third),
            frames=(*window.frames, third),
            fresh=False,
            landmarks=window.landmarks.merged(points),
        )

    def with_new_points(self, ids: NDArray[np.int64], x: Array) -> Window:
        """Adds points first seen in the last key frame to it."""
        key = self.keys[-1]
        key = replace(key, ids=np.concatenate([key.ids, ids]), x=np.concatenate([key.x, x]))
        return replace(self, keys=(*self.keys[:-1], key), frames=(*self.frames[:-1], key))

    def revised(self, poses: dict[int, Pose]) -> Window:
        """With other poses (by time) for some frames."""

        def renew(frame: Frame) -> Frame:
            pose = poses.get(frame.time_ns)
            return frame if pose is None else replace(frame, world_from_camera=pose)

        return replace(self, keys=tuple(map(renew, self.keys)), frames=tuple(map(renew, self.frames)))

    def restarted(self, frame: Frame) -> Window:
        """Nothing but this frame as first key frame, at the last known pose."""
        last = self.poses()
        base = last[-1][1] if last else self.base
        begun = Window((), self.frames, Points(), base, True, (*self.starts_ns[-8:], frame.time_ns))
        return begun.with_key(frame)

    def settle(self, count: int) -> tuple[Window, list[tuple[int, Pose]]]:
        """Keeps the last `count` key frames; the poses of the frames before them are settled and handed out.

        So are those of all but the newest MOST_WAITING frames after the last key frame: at rest, or where nothing is
        seen, none follows. They keep the poses that they were given at once, if any.
        """
        keys = self.keys[-count:]
        if not keys:
            return self, []
        start, last = keys[0].time_ns, keys[-1].time_ns
        waiting = [f.time_ns for f in self.frames if f.time_ns > last]
        given_up = set(waiting[:-MOST_WAITING])
        kept = [f.time_ns >= start and f.time_ns not in given_up for f in self.frames]
        settled = [
            (f.time_ns, f.world_from_camera)
            for f, keep in zip(self.frames, kept, strict=True)
            if not keep and f.world_from_camera is not None
        ]
        frames = tuple(f for f, keep in zip(self.frames, kept, strict=True) if keep)
        seen = np.unique(np.concatenate([k.ids for k in keys]))
        return replace(self, keys=keys, frames=frames, landmarks=self.landmarks.only(seen)), settled
