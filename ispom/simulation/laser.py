"""A laser profiler on the simulated rig: it turns about the direction of travel, and measures across the path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ispom.geometry import Pose
from ispom.simulation.caster import NOTHING
from ispom.simulation.meshes import MeshPlace
from ispom.simulation.scene import Scene
from ispom.solvers.trajectory.continuous import poses_at
from ispom.types import TimedPoints, Trajectory

SAMPLE_NS = 2_000_000
"""Between the true poses that a spline joins: a shake of 4 Hz is exact to 1e-9 m."""
NEAREST_M = 0.3


@dataclass(frozen=True)
class Profiler:
    """Profiles are turns about the laser's z axis; the beam starts along x and passes y, which points down."""

    points_hz: float = 30_000.0
    profiles_hz: float = 100.0
    reach_m: float = 30.0
    """What is farther away gives no point."""
    noise_m: float = 0.005
    """Standard deviation of a range."""
    rig_from_laser: Pose = Pose.from_rotvec(np.radians([2.0, -3.0, 1.0]), np.array([0.05, -0.12, -0.1]))

    def scan(
        self, scene: Scene | MeshPlace, pose_at: Callable[[int], Pose], start_ns: int, end_ns: int, seed: int
    ) -> TimedPoints:
        """All points of a time: of a platform that is at pose_at(time_ns) (world_from_rig) in a scene."""
        count = int((end_ns - start_ns) * 1e-9 * self.points_hz)
        times_ns = start_ns + np.rint(np.arange(count) * 1e9 / self.points_hz).astype(np.int64)
        angles = 2 * np.pi * self.profiles_hz * np.arange(count) / self.points_hz
        beams = np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], axis=1)
        path = true_path(pose_at, start_ns, end_ns).moved(right=self.rig_from_laser)
        poses = poses_at(path, times_ns, "spline")
        directions = np.einsum("nij,nj->ni", poses.rotations, beams)
        hits = scene.caster.hits(poses.translations, directions.astype(np.float32))
        seen = hits != NOTHING
        first, second, third = np.moveaxis(scene.triangles[hits].astype(float), 1, 0)
        normal = np.cross(second - first, third - first)
        with np.errstate(divide="ignore", invalid="ignore"):
            ranges = ((first - poses.translations) * normal).sum(axis=1) / (directions * normal).sum(axis=1)
        seen &= (ranges > NEAREST_M) & (ranges < self.reach_m)
        noise = np.random.default_rng([seed, 5]).normal(0, self.noise_m, count)
        return TimedPoints(times_ns[seen], ((ranges + noise)[:, None] * beams)[seen])


def true_path(pose_at: Callable[[int], Pose], start_ns: int, end_ns: int) -> Trajectory:
    """world_from_rig, densely."""
    times_ns = np.arange(start_ns, end_ns + SAMPLE_NS, SAMPLE_NS)
    return Trajectory.of([(t, pose_at(t)) for t in times_ns.tolist()])
