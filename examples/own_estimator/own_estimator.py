"""Visual odometry from frame to frame: each video frame against the one before it, every motion of length 1."""

from dataclasses import dataclass, field
from time import perf_counter
from typing import Annotated

import numpy as np

import ispom

INLIERS = ispom.Check("inliers", "tracks that agree", "requirement", "Located?")


@dataclass(frozen=True)
class FramesConfig:
    max_tracks: Annotated[int, ispom.Range(50, 2000)] = 400
    """Corners tracked at a time."""
    min_inliers: Annotated[int, ispom.Range(8, 500)] = 20
    """Fewer tracks that agree with one motion, and the frame is not located."""

    def build(self, rig):
        return Frames(rig.camera("video"), self)


@dataclass(frozen=True, eq=False)
class State:
    grey: np.ndarray | None = None
    tracks: ispom.Tracks = field(default_factory=lambda: ispom.Tracks.of(np.zeros(0), np.zeros(0)))
    pose: ispom.Pose = ispom.Pose()
    poses: ispom.PersistentList = ispom.PersistentList()
    next_id: int = 0


@dataclass(frozen=True)
class Frames:
    camera: object
    config: FramesConfig
    start, finish = staticmethod(State), staticmethod(lambda state: ispom.Trajectory.of(list(state.poses), "video"))

    def step(self, state, frame):
        begun, grey, old = perf_counter(), ispom.as_grey(frame.image), state.tracks
        uv, status = ispom.Klt().track(state.grey, grey, old.uv)
        alive = np.flatnonzero(status == ispom.TrackStatus.ALIVE)
        motion = ispom.relative_pose(*(self.camera.normalise(p[alive]) for p in (old.uv, uv)), 1 / self.camera.fx)
        inliers = 0 if motion is None else int(motion.inliers.sum())
        check = INLIERS.of(inliers, self.config.min_inliers)
        health = ispom.Status.LOST if len(state.poses) else ispom.Status.INITIALISING
        pose, poses = None, state.poses
        if motion is not None and check.passed:
            status[alive[~motion.inliers]] = ispom.TrackStatus.EPIPOLAR
            pose, health = state.pose @ motion.second_from_first.inverse(), ispom.Status.TRACKING
            poses = poses.appended((frame.time_ns, pose))
        kept = status == ispom.TrackStatus.ALIVE
        fresh = ispom.detect_corners(grey, self.config.max_tracks - int(kept.sum()), uv[kept])
        new, unknown = state.next_id + np.arange(len(fresh)), np.full((len(fresh), 2), np.nan)
        tracks = ispom.Tracks.of(
            np.concatenate([old.ids, new]),
            np.concatenate([np.where(kept[:, None], uv, old.uv), fresh]),
            uv_prev=np.concatenate([old.uv, unknown]),
            status=np.concatenate([status, np.full(len(fresh), ispom.TrackStatus.NEW)]),
        )
        seen = ispom.Tracks.of(*(values[tracks.status < ispom.TrackStatus.LOST] for values in (tracks.ids, tracks.uv)))
        after = State(grey, seen, pose or state.pose, poses, state.next_id + len(fresh))
        said = {"tracks": {"video": tracks}, "decisions": (check,), "seconds": {"all": perf_counter() - begun}}
        return after, ispom.Step(frame.time_ns, health, "video", pose, **said)


METHOD = ispom.Method("frames", frozenset({"video"}), FramesConfig, "own", "Nister 2004", checks={"inliers": INLIERS})
