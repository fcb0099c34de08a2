"""Points at times of their own, placed by poses: exact where the poses are."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Pose
from ispom.reconstruction.registration import registered, world_from_own
from ispom.simulation.motions import Flight
from ispom.types import TimedPoints, Trajectory

RNG = np.random.default_rng(0)
MOTION = Flight.seeded(1)
RIG_FROM_LASER = Pose.from_rotvec(np.array([0.1, -0.2, 0.3]), np.array([0.05, -0.1, 0.2]))
PATH = Trajectory.of([(t, MOTION.pose_at(t)) for t in range(0, 2_000_000_001, 20_000_000)])


def measured(times_ns: np.ndarray, xyz_in_world: np.ndarray) -> TimedPoints:
    seen = [
        (MOTION.pose_at(t) @ RIG_FROM_LASER).inverse().apply(xyz)
        for t, xyz in zip(times_ns.tolist(), xyz_in_world, strict=True)
    ]
    return TimedPoints(times_ns, np.array(seen))


def test_a_point_lands_where_it_was_measured() -> None:
    times_ns = RNG.integers(100_000_000, 1_900_000_000, 300)
    xyz = RNG.normal(0, 5, (300, 3))
    found = registered(measured(times_ns, xyz), PATH, RIG_FROM_LASER, "spline")
    assert len(found) == 300
    np.testing.assert_allclose(found.xyz_in_world, xyz, atol=2e-4)


def test_points_without_a_pose_are_skipped() -> None:
    times_ns = np.array([-5, 1_000_000_000, 2_000_000_005])
    found = registered(measured(times_ns, np.ones((3, 3))), PATH, RIG_FROM_LASER, "linear")
    assert found.index.tolist() == [1]


def test_a_straight_path_is_laid_on_another_by_its_orientations_too() -> None:
    straight = np.column_stack([np.zeros((50, 2)), np.arange(50.0)])
    world = Trajectory(np.arange(50), np.tile(np.eye(3), (50, 1, 1)), straight)
    moved = Pose.from_rotvec(np.array([0.3, 0.1, -0.7]), np.array([3.0, -2.0, 1.0]))
    found = world_from_own(world.moved(left=moved.inverse()), world)
    np.testing.assert_allclose(found.matrix, moved.matrix, atol=1e-9)
