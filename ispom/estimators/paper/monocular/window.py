"""The last key frames, the frames between them, and the points that they see."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.geometry import Array, Pose
from ispom.solvers.multiview.triple import Triple

MAX_WAITING = 300
"""Frames after the last key frame whose poses may still change: 10 s at 30 Hz."""
MAX_STARTS = 9
"""Times of starts that are remembered: those within a segment of the integration matter, and there one is too many."""


@dataclass(frozen=True, eq=False)
class KeyFrameWindow:
    """The last key frames, all frames since the oldest of them, and the points that they see."""

    keys: tuple[TrackedFrame, ...] = ()
    frames: tuple[TrackedFrame, ...] = ()
    """In order of time, key frames included."""
    landmarks: ScenePoints = ScenePoints()
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

    def is_key(self, time_ns: int) -> bool:
        """Whether the newest key frame is of this time."""
        return bool(self.keys) and self.keys[-1].time_ns == time_ns

    def poses(self) -> list[tuple[int, Pose]]:
        return [(f.time_ns, f.world_from_camera) for f in self.frames if f.world_from_camera is not None]

    def predicted(self) -> Pose | None:
        """world_from_camera of the next frame, at the velocity of the last two poses; None without a triple yet."""
        known = [f.world_from_camera for f in self.frames if f.world_from_camera is not None][-2:]
        if self.fresh or not known:
            return None
        return known[-1] @ known[0].inverse() @ known[-1]

    def with_frame(self, frame: TrackedFrame) -> KeyFrameWindow:
        return replace(self, frames=(*self.frames, frame))

    def with_key(self, frame: TrackedFrame) -> KeyFrameWindow:
        """A key frame without a triple: one of the first two after a (new) start."""
        if not self.keys:
            frame = replace(frame, world_from_camera=self.base)
        return replace(self, keys=(*self.keys, frame), frames=(*self.frames, frame))

    def with_triple(self, triple: Triple, ids: NDArray[np.int64], third: TrackedFrame, scale: float) -> KeyFrameWindow:
        """Places key frames 2 and 3 and the points of a triple, in the world and at its scale."""
        world_from_first = self.keys[-2].world_from_camera
        assert world_from_first is not None
        second = world_from_first @ triple.second_from_first.inverse().scaled(scale)
        third = replace(third, world_from_camera=world_from_first @ triple.third_from_first.inverse().scaled(scale))
        window = self.revised({self.keys[-1].time_ns: second})
        good = triple.resected
        points = ScenePoints(ids[good], world_from_first.apply(scale * triple.xyz_in_first[good]))
        return replace(
            window,
            keys=(*window.keys, third),
            frames=(*window.frames, third),
            fresh=False,
            landmarks=window.landmarks.merged(points),
        )

    def with_new_points(self, ids: NDArray[np.int64], x: Array) -> KeyFrameWindow:
        """Adds points first seen in the last key frame to it."""
        key = self.keys[-1].with_new(ids, x)
        return replace(self, keys=(*self.keys[:-1], key), frames=(*self.frames[:-1], key))

    def revised(self, poses: dict[int, Pose]) -> KeyFrameWindow:
        """With other poses (by time) for some frames."""

        def renew(frame: TrackedFrame) -> TrackedFrame:
            pose = poses.get(frame.time_ns)
            return frame if pose is None else replace(frame, world_from_camera=pose)

        return replace(self, keys=tuple(map(renew, self.keys)), frames=tuple(map(renew, self.frames)))

    def restarted(self, frame: TrackedFrame) -> KeyFrameWindow:
        """Nothing but this frame as first key frame, at the last known pose."""
        last = self.poses()
        base = last[-1][1] if last else self.base
        begun = KeyFrameWindow(
            (), self.frames, ScenePoints(), base, True, (*self.starts_ns[1 - MAX_STARTS :], frame.time_ns)
        )
        return begun.with_key(frame)

    def settle(self, count: int) -> tuple[KeyFrameWindow, list[tuple[int, Pose]]]:
        """Keeps the last `count` key frames; the poses of the frames before them are settled and handed out.

        So are those of all but the newest MAX_WAITING frames after the last key frame: at rest, or where nothing is
        seen, none follows. They keep the poses that they were given at once, if any.
        """
        keys = self.keys[-count:]
        if not keys:
            return self, []
        start, last = keys[0].time_ns, keys[-1].time_ns
        waiting = [f.time_ns for f in self.frames if f.time_ns > last]
        given_up = set(waiting[:-MAX_WAITING])
        kept = [f.time_ns >= start and f.time_ns not in given_up for f in self.frames]
        settled = [
            (f.time_ns, f.world_from_camera)
            for f, keep in zip(self.frames, kept, strict=True)
            if not keep and f.world_from_camera is not None
        ]
        frames = tuple(f for f, keep in zip(self.frames, kept, strict=True) if keep)
        seen = np.unique(np.concatenate([k.ids for k in keys]))
        return replace(self, keys=keys, frames=frames, landmarks=self.landmarks.only(seen)), settled
