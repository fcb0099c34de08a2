"""Applies the corrections by loops to poses, landmarks and Steps of the odometry."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ispom.estimators.modern.loops.loops import Loops, covariance_at
from ispom.geometry import Array, Pose, Similarity, slerp
from ispom.types import Step, Trajectory

AT_ONCE = 200
"""Largest number of earlier poses corrected per frame."""


@dataclass(frozen=True, eq=False)
class Correction:
    """corrected_world_from_world over time: known at the nodes, interpolated between them."""

    times_ns: np.ndarray
    """(N,) times of the nodes."""
    values: tuple[Similarity, ...]
    follows: tuple[bool, ...]
    """Whether the pose of each node was estimated from the one before; otherwise nothing is interpolated between
    them."""

    @staticmethod
    def of(loops: Loops) -> Correction:
        nodes = loops.nodes
        parents = [False, *(n.connected and n.parent_ns == b.time_ns for b, n in pairwise(nodes))]
        return Correction(
            np.array([n.time_ns for n in nodes], np.int64), tuple(n.correction for n in nodes), tuple(parents)
        )

    def applied(self, time_ns: int, world_from_frame: Pose) -> Pose:
        """Returns the pose in the corrected world, in its scale."""
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
    """Returns the loops with less left to correct, and the indices of the poses to correct now, newest first; `poses`
    is their number."""
    if not loops.uncorrected:
        return loops, range(0)
    stop = min(loops.corrected_to, poses) or min(loops.end, poses)
    start = max(stop - min(AT_ONCE, loops.uncorrected), 0)
    return replace(loops, corrected_to=start, uncorrected=loops.uncorrected - (stop - start)), range(start, stop)


def corrected_step(
    loops: Loops,
    step: Step,
    earlier: list[tuple[int, Pose]],
    odometry: tuple[Pose, Array, float] | None,
    camera_from_frame: Pose,
) -> Step:
    """Returns a Step of the odometry in the corrected world, with earlier poses revised.

    `odometry`: world_from_camera, its covariance (6, 6), and the variance of ln scale; None where they are unknown.
    """
    covariance = None if odometry is None else covariance_at(loops, *odometry)
    return moved_step(step, loops.correction, Correction.of(loops), earlier, covariance, camera_from_frame)


def moved_step(
    step: Step,
    newest: Similarity,
    correction: Correction,
    earlier: list[tuple[int, Pose]],
    of_camera: Array | None,
    camera_from_frame: Pose,
) -> Step:
    """Returns a Step in another world, with earlier poses revised.

    Args:
        newest: to that world from that of the step.
        correction: the same for the poses it revises.
        earlier: poses to revise besides.
        of_camera: (7, 7) covariance of the right perturbation of the camera's pose in the other world; None where it is
            unknown.
    """
    earlier = [(t, pose) for t, pose in earlier if t < step.time_ns]
    revised = Trajectory.of([*earlier, *step.revised.items()], step.frame)
    pose, covariance, scale_sigma = step.world_from_frame, None, step.scale_sigma
    if pose is not None:
        pose = newest.apply_pose(pose)
        if of_camera is not None:
            back = camera_from_frame.inverse().adjoint
            scale = np.diag(np.repeat([newest.scale, 1.0], 3))
            covariance = scale @ (back @ of_camera[:6, :6] @ back.T) @ scale
            scale_sigma = None if scale_sigma is None else float(np.sqrt(of_camera[6, 6]))
    return replace(
        step,
        world_from_frame=pose,
        covariance=covariance,
        landmarks=replace(step.landmarks, xyz_in_world=newest.apply(step.landmarks.xyz_in_world)),
        revised=correction.of_trajectory(revised),
        scale_sigma=scale_sigma,
    )
