"""Finds, during a run, where a trajectory with its own unit or world is drawn in the shared metric world."""

from __future__ import annotations

import sys
from bisect import bisect_left, bisect_right
from copy import copy

import numpy as np

from ispom.evaluation.scale import first_segment_placement
from ispom.geometry import Pose, Similarity
from ispom.types import FrameName, Rig, Trajectory


class Placing:
    """Waits for the first segment between stereo poses that the video poses span. It fixes position and unit for good.

    Until then poses are only collected.
    """

    def __init__(self, rig: Rig, scale: float | None = None, spacing_ns: int = 0) -> None:
        """`scale` is the trajectory's unit [m], where it is known. `spacing_ns` is the least interval between metric
        poses; poses in between are skipped."""
        self._rig, self._scale, self._spacing_ns = rig, scale, spacing_ns
        self._frame: FrameName = "video"
        self._metric: dict[int, Pose] = {}
        self._video: dict[int, Pose] = {}
        self._times_ns: list[int] = []
        """Times of the metric poses, increasing."""
        self._first_ns, self._last_ns = sys.maxsize, -1

    def copy(self) -> Placing:
        """Returns an independent copy."""
        other = copy(self)
        other._metric, other._video, other._times_ns = self._metric.copy(), self._video.copy(), self._times_ns.copy()
        return other

    def add_metric(self, time_ns: int, world_from_rig: Pose) -> None:
        if self._times_ns and time_ns < self._times_ns[-1] + self._spacing_ns:
            return
        self._metric[time_ns] = world_from_rig
        self._times_ns.append(time_ns)

    def add_video(self, world_from_video: Trajectory) -> None:
        """Adds poses; they replace those of the same times."""
        if len(world_from_video):
            self._frame = world_from_video.frame
            self._video |= dict(world_from_video.items())
            self._first_ns = min(self._first_ns, int(world_from_video.times_ns[0]))
            self._last_ns = max(self._last_ns, int(world_from_video.times_ns[-1]))

    def found(self) -> Similarity | None:
        """Returns metric_world_from_video_world as soon as it is known. After that the object is of no more use."""
        inside = bisect_left(self._times_ns, self._first_ns)
        if len(self._video) < 2 or bisect_right(self._times_ns, self._last_ns) - inside < 2:
            return None
        video = Trajectory.of(list(self._video.items()), self._frame)
        found = first_segment_placement(video, Trajectory.of(list(self._metric.items())), self._rig, self._scale)
        if found is None:  # the platform stood still: the next segment may have a length
            start = self._first_ns = self._times_ns[inside] + 1
            self._video = {t: pose for t, pose in self._video.items() if t >= start}
        return found


def same_place(a: Similarity | None, b: Similarity | None) -> bool:
    """Whether two placements are equal, not only the same object."""
    if a is None or b is None:
        return a is b
    return a is b or (a.scale == b.scale and np.array_equal(a.pose.matrix, b.pose.matrix))
