"""Common parts of the survey's methods: the State around a method's own memory, and the Step from its result.

A method here is a class with `begin` and `process`. Its state from frame to frame is its `Memory`, a frozen dataclass.
The classes here keep poses, times and stages for it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ispom.estimator import require_frame
from ispom.geometry import Array, Pose
from ispom.persistent_list import PersistentList
from ispom.stopwatch import Stopwatch
from ispom.types import (
    Decision,
    Frame,
    ImageLines,
    Kind,
    Landmarks,
    Measurement,
    Rig,
    Status,
    Step,
    Tracks,
    TrackStatus,
    Trajectory,
    WorldLines,
)
from ispom.types.rig import FrameName

Memory = TypeVar("Memory")


@dataclass(frozen=True, eq=False)
class Result:
    """The result of a method for one frame."""

    pose: Pose | None = None
    """world_from_frame; None where the frame was not located."""
    decisions: tuple[Decision, ...] = ()
    tracks: dict[str, Tracks] = field(default_factory=dict)
    """By camera name."""
    landmarks: Landmarks = field(default_factory=Landmarks.empty)
    residuals_px: Array = field(default_factory=lambda: np.zeros(0))
    """(K,) of the inliers."""
    covariance: Array | None = None
    """(6, 6) of the twist on the right of the pose."""
    key_frame: bool = False
    lines: dict[str, ImageLines] = field(default_factory=dict)
    """By camera name, the lines that are drawn on its image."""
    world_lines: WorldLines = field(default_factory=WorldLines.empty)
    restarted: bool = False
    """A new segment begins here."""
    revised: Trajectory = field(default_factory=Trajectory.empty)
    """Poses of earlier frames that this one improved; a method that has any gives them in `finish`, too."""
    scale_sigma: float | None = None
    """See Step."""
    provisional: bool = False
    """See Step."""
    status: Status | None = None
    """None: tracking with a pose; without one initialising before the first pose, and lost after it."""


@dataclass(frozen=True, eq=False)
class State(Generic[Memory]):
    """The State of each method here."""

    memory: Memory
    poses: PersistentList[tuple[int, Pose]] = PersistentList()
    """(time_ns, world_from_frame)."""
    last_ns: int | None = None


class OneKind(Generic[Memory]):
    """An estimator that steps on frames of one kind; a method derives from it, and gives `begin` and `process`."""

    rig: Rig
    kind: Kind = "video"
    """`video`, `stereo` or `cameras`."""
    frame: FrameName = "video"
    """The frame of the pose that `process` returns: the video camera if there is no scale, else the rig."""

    def begin(self) -> Memory:
        """Returns the memory before the first frame."""
        raise NotImplementedError

    def process(self, memory: Memory, frame: Frame, watch: Stopwatch) -> tuple[Memory, Result]:
        """Returns the memory after the frame, and the result for it. `watch.lap(STAGE)` ends a stage."""
        raise NotImplementedError

    def start(self) -> State[Memory]:
        """See Estimator."""
        return State(self.begin())

    def step(self, state: State[Memory], measurement: Measurement, /) -> tuple[State[Memory], Step]:
        """See Estimator. Raises InputError for a measurement of another kind, one that is not later, or an
        image of another size than its camera."""
        frame, watch = require_frame(measurement, frozenset({self.kind}), state.last_ns, self.rig), Stopwatch()
        memory, result = self.process(state.memory, frame, watch)
        poses = state.poses if result.pose is None else state.poses.appended((frame.time_ns, result.pose))
        without_pose = Status.LOST if len(poses) else Status.INITIALISING
        status = result.status or (without_pose if result.pose is None else Status.TRACKING)
        step = Step(
            frame.time_ns,
            status,
            self.frame,
            result.pose,
            covariance=result.covariance,
            key_frame=result.key_frame,
            tracks=result.tracks,
            landmarks=result.landmarks,
            residuals_px=result.residuals_px,
            decisions=result.decisions,
            seconds=watch.seconds,
            restarted=result.restarted,
            lines=result.lines,
            world_lines=result.world_lines,
            revised=result.revised,
            scale_sigma=result.scale_sigma,
            provisional=result.provisional,
        )
        return replace(state, memory=memory, poses=poses, last_ns=frame.time_ns), step

    def finish(self, state: State[Any], /) -> Trajectory:
        """See Estimator: the poses as they were found."""
        return Trajectory.of(list(state.poses), self.frame)


def tracks_between(
    ids: NDArray[np.int64],
    uv: NDArray[np.floating],
    uv_prev: NDArray[np.floating] | None = None,
    inliers: NDArray[np.bool_] | None = None,
    residual_px: Array | None = None,
) -> Tracks:
    """Returns tracks for display: ids (N,), positions (N, 2) now and before [px] (NaN: first seen in this frame).

    `inliers` (N,): others end as outliers of the motion. `residual_px` (N,).
    """
    before = np.full((len(ids), 2), np.nan) if uv_prev is None else uv_prev
    status = np.where(np.isnan(before[:, 0]), TrackStatus.NEW, TrackStatus.ALIVE).astype(np.uint8)
    if inliers is not None:
        status[~inliers & (status == TrackStatus.ALIVE)] = TrackStatus.EPIPOLAR
    values = {} if residual_px is None else {"residual_px": residual_px.astype(np.float32)}
    return Tracks.of(ids, uv, uv_prev=before, status=status, **values)
