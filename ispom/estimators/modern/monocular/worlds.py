"""Which segments were joined with earlier ones, and where their poses are in the common world."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ispom.estimators.modern.loops.output_correction import Correction
from ispom.geometry import Array, Pose, Similarity


@dataclass(frozen=True, eq=False)
class Visit:
    """A stretch of frames in one segment: the camera may return to it."""

    time_ns: int
    """Time of its first frame."""
    segment: int
    settled: int
    """Number of final poses before it."""


@dataclass(frozen=True, eq=False)
class Recognised:
    """A keyframe that observes points of an earlier segment."""

    segment: int
    earlier: int
    """The earlier segment."""
    earlier_from_camera: Similarity
    """The keyframe's pose in the earlier world; `scale` is the earlier unit per unit of its own segment."""
    covariance: Array
    """(7, 7) covariance of its right perturbation."""
    world_from_camera: Pose
    """The pose in the keyframe's own world."""
    own_covariance: Array
    """(6, 6) covariance of that pose, right twist."""
    own_scale_sigma: float
    """Standard deviation of ln scale in its own world."""
    depth: float
    """Median depth of the common points, in the segment's own unit."""
    pair: tuple[int, int] = (0, 0)
    """Times of the earlier keyframe that it matched, and of the keyframe itself [ns]."""

    @property
    def scale_sigma(self) -> float:
        """Standard deviation of ln scale."""
        return float(np.sqrt(self.covariance[6, 6]))

    @property
    def earlier_from_own(self) -> Similarity:
        return self.earlier_from_camera @ Similarity(1.0, self.world_from_camera.inverse())


@dataclass(frozen=True, eq=False)
class Worlds:
    visits: tuple[Visit, ...] = ()
    joined: tuple[Recognised, ...] = ()
    """For each joined segment, the keyframe by which it was joined with an earlier one."""
    recognised: tuple[Recognised, ...] = ()
    """Keyframes of the current segment that show an earlier one; not enough of them agree yet."""
    unlike: int = 0
    """Number of the last keyframes of the current segment that match no earlier one."""
    pending: range = range(0)
    """Indices of final poses that are still to be revised."""

    def visited(self, segment: int, time_ns: int, settled: int) -> Worlds:
        """Returns the worlds after a frame in this segment; `settled`: the number of final poses before it."""
        if self.visits and self.visits[-1].segment == segment:
            return self
        return replace(self, visits=(*self.visits, Visit(time_ns, segment, settled)), recognised=(), unlike=0)

    def join_of(self, segment: int) -> Recognised | None:
        """Returns by which keyframe the segment was joined with an earlier one; None if it was not."""
        return next((j for j in self.joined if j.segment == segment), None)

    def root(self, segment: int) -> int:
        """Returns the segment in whose world the poses of a segment are reported."""
        join = self.join_of(segment)
        return segment if join is None else self.root(join.earlier)

    def root_from(self, segment: int) -> Similarity:
        """Returns the similarity from the world of a segment to that of its root."""
        join = self.join_of(segment)
        return Similarity() if join is None else self.root_from(join.earlier) @ join.earlier_from_own

    def joined_by(self, keyframe: Recognised, settled: int) -> Worlds:
        """Joins the segment of a keyframe; `settled`: the number of final poses so far."""
        first = min(v.settled for v in self.visits if v.segment == keyframe.segment)
        pending = range(min(first, self.pending.start) if self.pending else first, settled)
        return replace(self, joined=(*self.joined, keyframe), recognised=(), pending=pending)

    @cached_property
    def correction(self) -> Correction:
        """Returns the correction from the world of each pose to the world of its root."""
        times = np.array([v.time_ns for v in self.visits], np.int64)
        values = tuple(self.root_from(v.segment) for v in self.visits)
        return Correction(times, values, (False,) * len(values))

    def next_pending(self, most: int) -> tuple[Worlds, range]:
        """Returns the worlds with fewer pending poses, and the indices of the newest pending poses, to be revised
        now."""
        start = max(self.pending.start, self.pending.stop - most)
        return replace(self, pending=range(self.pending.start, start)), range(start, self.pending.stop)
