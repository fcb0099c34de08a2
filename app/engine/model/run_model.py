"""The results of a run so far: the poses of each method by time and its points by id, as one value for each frame.

model = RunModel.start(methods)
model = model.after(index, time_ns, steps)      # shares all but what this frame changed
model.as_known_at(k, steps_at)                  # as it was after frame k, revised poses as known then
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.types import FrameName, Status, Step, Trajectory

from .points import PointMap
from .poses import POSES_PER_BLOCK, PoseBlock, PoseHistory, Times


@dataclass(frozen=True)
class MethodTally:
    """Counts of the frames that a method used."""

    exposures: int = 0
    lost: int = 0
    key_frames: int = 0
    provisional: bool = False
    """Whether the latest pose is not metric yet."""

    def after(self, step: Step) -> MethodTally:
        return replace(
            self,
            exposures=self.exposures + 1,
            lost=self.lost + (step.status == Status.LOST),
            key_frames=self.key_frames + step.key_frame,
            provisional=step.provisional,
        )


@dataclass(frozen=True)
class Tally:
    """Counts by method."""

    methods: Mapping[str, MethodTally] = field(default_factory=dict)

    def after(self, steps: Iterable[Step]) -> Tally:
        found = dict(self.methods)
        for step in steps:
            found[step.method] = found.get(step.method, MethodTally()).after(step)
        return Tally(found)


@dataclass(frozen=True, eq=False)
class MethodModel:
    """Poses and points of one method, in its own world."""

    poses: PoseHistory
    points: PointMap
    covariance: Array | None = None
    """(6, 6) of the newest pose, as Step.covariance; None where the method gave none."""


@dataclass(frozen=True, eq=False)
class RunModel:
    times: Times
    methods: Mapping[str, MethodModel]

    @staticmethod
    def start(methods: Iterable[str]) -> RunModel:
        """Returns the model before the first frame. Its points are thinned, for drawing."""
        return RunModel(Times.none(), {m: MethodModel(PoseHistory(), PointMap(thinned=True)) for m in methods})

    def after(self, index: int, time_ns: int, steps: Iterable[Step]) -> RunModel:
        """Returns the model with the steps of frame `index`: their poses, revised poses, keyframes, and points."""
        times, methods = self.times.with_exposure(index, time_ns), dict(self.methods)
        for step in steps:
            known = methods[step.method]
            poses = _with_step(known.poses, times, step, index)
            points = known.points.with_points(step.landmarks, index)
            covariance = known.covariance if step.world_from_frame is None else step.covariance
            methods[step.method] = MethodModel(poses, points, covariance)
        return RunModel(times, methods)

    def of(self, methods: Iterable[str]) -> RunModel:
        """Returns the model of these methods; it is empty for a method that did not run."""
        none = RunModel.start(methods).methods
        return RunModel(self.times, {m: self.methods.get(m, nothing) for m, nothing in none.items()})

    def with_final(self, trajectories: Mapping[str, Trajectory]) -> RunModel:
        """Returns the model with the final trajectories in place of the poses known so far."""
        index, methods = int(self.times.indices(slice(-1, None)).max(initial=0)), dict(self.methods)
        for method, poses in trajectories.items():
            known = methods[method]
            rows = self.times.rows(poses.times_ns)
            methods[method] = replace(known, poses=known.poses.with_poses(rows, poses, index))
        return replace(self, methods=methods)

    def as_known_at(self, index: int, steps_at: Callable[[int], tuple[Step, ...]]) -> RunModel:
        """Returns the model as it was after frame `index`. `steps_at` gives the steps of earlier frames, from which
        blocks that changed since are computed again.

        Points are those known then, at the positions known now.
        """
        times = replace(self.times, count=self.times.rows_until(index))
        steps = cache(steps_at)
        found = {}
        for method, known in self.methods.items():
            blocks = known.poses.blocks[: -(-times.count // POSES_PER_BLOCK)]
            past = (_block_at(b, block, times, index, method, steps) for b, block in enumerate(blocks))
            poses, points = replace(known.poses, blocks=tuple(past)), _points_at(known.points, index)
            found[method] = MethodModel(poses, points, _covariance_at(poses, times, index, method, steps))
        return RunModel(times, found)


def _with_step(poses: PoseHistory, times: Times, step: Step, index: int) -> PoseHistory:
    poses = poses.with_poses(times.rows(step.revised.times_ns), step.revised, index)
    row = times.rows(np.array([step.time_ns]))
    if step.restarted:
        poses = poses.with_start(int(times.rows(np.array([step.segment_from_ns]))[0]))
    if step.world_from_frame is not None:
        poses = poses.with_poses(row, _single(step.time_ns, step.world_from_frame, step.frame), index)
    return poses.with_key_frame(int(row[0]), index) if step.key_frame else poses


def _block_at(
    b: int, block: PoseBlock, times: Times, index: int, method: str, steps_at: Callable[[int], tuple[Step, ...]]
) -> PoseBlock:
    """Returns the block as it was after a frame, from an earlier version and the steps after it."""
    while block.changed > index and block.since > index and block.earlier is not None:
        block = block.earlier
    if block.changed <= index:
        return block
    start, start_row = block.since, b * POSES_PER_BLOCK
    found = PoseHistory((block.earlier or PoseBlock.empty(start),))
    inside = Times(times.count, times.times_ns(slice(None)), times.indices(slice(None)))
    for i in range(start, index + 1):
        for step in steps_at(i):
            if step.method == method:
                found = _within(found, inside, step, i, start_row)
    return found.blocks[0]


def _covariance_at(
    poses: PoseHistory, times: Times, index: int, method: str, steps_at: Callable[[int], tuple[Step, ...]]
) -> Array | None:
    """Returns the covariance of the newest pose, from the last step that gave it up to `index`."""
    row = poses.last_known()
    if row is None:
        return None
    first = int(times.indices(slice(row, row + 1))[0])
    following = times.indices(slice(row + 1, row + 2))
    last = int(following[0]) if len(following) else index + 1
    steps = [step for i in range(first, last) for step in steps_at(i) if step.method == method]
    return next((s.covariance for s in reversed(steps) if s.world_from_frame is not None), None)


def _within(poses: PoseHistory, times: Times, step: Step, index: int, start_row: int) -> PoseHistory:
    """Returns the poses of one block with those of a step."""

    def of_block(trajectory: Trajectory) -> tuple[NDArray[np.int64], Trajectory]:
        rows = times.rows(trajectory.times_ns) - start_row
        chosen = (rows >= 0) & (rows < POSES_PER_BLOCK)
        return rows[chosen], trajectory.select(chosen)

    row = times.rows(np.array([step.time_ns]))[0] - start_row
    poses = poses.with_poses(*of_block(step.revised), index)
    if step.world_from_frame is not None:
        poses = poses.with_poses(*of_block(_single(step.time_ns, step.world_from_frame, step.frame)), index)
    return poses.with_key_frame(int(row), index) if step.key_frame and 0 <= row < POSES_PER_BLOCK else poses


def _points_at(points: PointMap, index: int) -> PointMap:
    """Returns the points known at a frame. Blocks whose points were all known stay the same objects."""
    blocks = []
    for block in points.blocks:
        count = int(np.searchsorted(block.born, index, side="right"))
        if count == len(block.ids):
            blocks.append(block)
        elif count:
            cut = (block.ids[:count], block.xyz[:count], block.rgb[:count], block.born[:count])
            blocks.append(replace(block, **dict(zip(("ids", "xyz", "rgb", "born"), cut, strict=True))))
    return replace(points, blocks=tuple(blocks), count=sum(len(block.ids) for block in blocks))


def _single(time_ns: int, pose: Pose, frame: FrameName) -> Trajectory:
    return Trajectory(np.array([time_ns]), pose.rotation[None], pose.translation[None], frame)
