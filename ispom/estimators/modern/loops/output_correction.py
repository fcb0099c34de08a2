"""Poses, points and Steps as they are with the loops, from those of the odometry."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ispom.estimators.modern.loops.loops import Loops
from ispom.geometry import Array, Pose, Similarity, slerp
from ispom.types import Landmarks, Trajectory

AT_ONCE = 200
"""Poses told anew in one exposure."""


@dataclass(frozen=True, eq=False)
class Correction:
    """corrected_world_from_world over time: those of the nodes, and between two of them a mean of what they say."""

    times_ns: np.ndarray
    """(N,)."""
    values: tuple[Similarity, ...]
    follows: tuple[bool, ...]
    """Of each whether its pose was found from the one before: else nothing is between them."""

    @staticmethod
    def of(loops: Loops) -> Correction:
        nodes = loops.nodes
        parents = [False, *(n.seen and n.parent_ns == b.time_ns for b, n in pairwise(nodes))]
        return Correction(
            np.array([n.time_ns for n in nodes], np.int64), tuple(n.correction for n in nodes), tuple(parents)
        )

    def applied(self, time_ns: int, world_from_frame: Pose) -> Pose:
        """The pose in the corrected world, in its unit."""
        i = max(int(np.searchsorted(self.times_ns, time_ns, side="right")) - 1, 0)
        before = self.values[i].apply_pose(world_from_frame)
        if i + 1 == len(self.values) or not self.follows[i + 1] or time_ns <= self.times_ns[i]:
            return before
        after = self.values[i + 1].apply_pose(world_from_frame)
        share = (time_ns - self.times_ns[i]) / (self.times_ns[i + 1] - self.times_ns[i])
        turn = slerp(before.rotation, after.rotation, np.array([share]))[0]
        return Pose(turn, (1 - share) * before.translation + share * after.translation)

    def of_trajectory(self, trajectory: Trajectory) -> Trajectory:
        return Trajectory.of([(t, self.applied(t, pose)) for t, pose in trajectory.items()], trajectory.frame)


def next_range(loops: Loops, poses: int) -> tuple[Loops, range]:
    """Which of so many poses are told anew now, by their numbers: the newest ones first; and what is left then."""
    if not loops.left:
        return loops, range(0)
    stop = min(loops.told, poses) or min(loops.end, poses)
    start = max(stop - min(AT_ONCE, loops.left), 0)
    return replace(loops, told=start, left=loops.left - (stop - start)), range(start, stop)


def landmarks_at(landmarks: Landmarks, correction: Similarity) -> Landmarks:
    return replace(landmarks, xyz_in_world=correction.apply(landmarks.xyz_in_world))


def in_frame(covariance: Array, camera_from_frame: Pose, scale: float) -> Array:
    """(6, 6) of world_from_frame's right twist in the corrected unit, from (7, 7) of world_from_camera's in its own."""
    way = camera_from_frame.inverse().adjoint
    own = way @ covariance[:6, :6] @ way.T
    unit = np.diag(np.repeat([scale, 1.0], 3))
    return unit @ own @ unit
