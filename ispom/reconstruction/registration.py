"""Points of another sensor in one frame: each is placed by the pose that the rig had at the point's own time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.geometry import Array, Pose
from ispom.solvers.trajectory.continuous import Between, known_at, poses_at
from ispom.types import TimedPoints, Trajectory

_AT_ONCE = 200_000


@dataclass(frozen=True, eq=False)
class Registered:
    """Points in the world of a trajectory."""

    xyz_in_world: Array
    """(N, 3) [m]."""
    index: NDArray[np.intp]
    """(N,) index of each among the input points: those at times without poses are skipped."""

    def __len__(self) -> int:
        return len(self.index)


def registered(points: TimedPoints, path: Trajectory, rig_from_laser: Pose, between: Between) -> Registered:
    """Transforms points by the poses world_from_rig of `path`, interpolated at each point's time.

    Points at times outside of the path, and in gaps of it, are skipped.
    """
    index = np.flatnonzero(known_at(path, points.times_ns))
    xyz = [np.zeros((0, 3))]
    for start in range(0, len(index), _AT_ONCE):
        some = index[start : start + _AT_ONCE]
        poses = poses_at(path, points.times_ns[some], between)
        in_rig = rig_from_laser.apply(points.xyz_in_laser[some])
        xyz.append(np.einsum("nij,nj->ni", poses.rotations, in_rig) + poses.translations)
    return Registered(np.concatenate(xyz), index)


def world_from_own(own: Trajectory, world: Trajectory) -> Pose:
    """Returns the motion that brings poses (N) closest to others at the same times (N), N >= 1, in position and
    orientation.

    Positions only would leave the rotation about a straight path undetermined.
    """
    turn = Rotation.from_matrix(world.rotations @ own.rotations.transpose(0, 2, 1)).mean().as_matrix()
    return Pose(turn, (world.translations - own.translations @ turn.T).mean(axis=0))
