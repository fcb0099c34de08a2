"""Laser scanners: scans whose points have times of their own, matched with the scan of the node before.

Their files are tables of ranges, a row for each scan, or points with times (see `ispom.io.timed_points`).

Scans are taken to see vertical walls. Reference: Koide 2024, "small_gicp" (generalised ICP).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.plausibility.times import Rates
from ispom.sensors.fusion import FLOOR_M, FLOOR_RAD, Factor, GraphFrames, Link, Node, NodeContext, between, link_in_rig
from ispom.sensors.kind import FileOptions, Readings, SensorKind, Table
from ispom.sensors.simulated import LEVEL_FROM_VEHICLE, Scene, Scenery, SensorFaults
from ispom.settings import Range
from ispom.solvers.trajectory.continuous import poses_at
from ispom.types import LaserScan, LaserScanner, Measurement, TimedPoints, Trajectory

FREE_M, FREE_RAD = 1.0, 0.1
"""Standard deviations of what a level scanner does not measure [m], [rad]."""
LAYERS_M = np.array([-0.5, 0.0, 0.5])
"""A scan of one level is matched as walls: points are repeated at these heights."""
GICP_PER_M2 = 500.0
"""Information that small_gicp gives one point along the normal of its wall [1/m^2]: 1 / (2 * 1e-3)."""
CORRELATED = 3.0
"""Neighbouring points of a scan have similar errors (the wall is uneven): factor of the covariance."""
REACH_M = 1.0
"""Points of two scans are matched within this distance."""
FEWEST_MATCHED = 60
SKEWED = 25.0
"""Factor of the covariance of scans before the start, which the motion within a scan has skewed."""
PATH_NS = 1_500_000_000
"""Length of the path by which scans are straightened."""
SAMPLE_NS = 2_000_000
"""Interval of the true poses that a spline joins: a shake of 4 Hz is exact to 1e-9 m."""
BACK_RAD = 1.0
"""A scan ends where the azimuth turns back by more than this: noise turns it back by less."""
PAUSE_NS = 1_000_000_000
"""A scan ends where nothing is measured for longer: no scanner turns as slowly."""
NEAREST_M = 0.3
"""Simulated scanners measure nothing that is nearer."""


# What is simulated.


@dataclass(frozen=True)
class Profiler:
    """A laser profiler on the rig. Profiles are rotations about its z axis; the beam starts along x and passes y
    (down)."""

    points_hz: float = 30_000.0
    profiles_hz: float = 100.0
    reach_m: float = 30.0
    """Points farther away are skipped."""
    noise_m: float = 0.005
    """Standard deviation of a range."""
    rig_from_laser: Pose = Pose.from_rotvec(np.radians([2.0, -3.0, 1.0]), np.array([0.05, -0.12, -0.1]))

    def scan(self, scene: Scene, pose_at: Callable[[int], Pose], start_ns: int, end_ns: int, seed: int) -> TimedPoints:
        """Returns all points within a time, for a platform at pose_at(time_ns) (world_from_rig) in a scene."""
        count = int((end_ns - start_ns) * 1e-9 * self.points_hz)
        times_ns = start_ns + np.rint(np.arange(count) * 1e9 / self.points_hz).astype(np.int64)
        angles = 2 * np.pi * self.profiles_hz * np.arange(count) / self.points_hz
        beams = np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], axis=1)
        path = true_path(pose_at, start_ns, end_ns).moved(right=self.rig_from_laser)
        poses = poses_at(path, times_ns, "spline")
        directions = np.einsum("nij,nj->ni", poses.rotations, beams)
        hits = scene.caster.hits(poses.translations, directions.astype(np.float32))
        seen = hits >= 0
        first, second, third = np.moveaxis(scene.triangles[hits].astype(float), 1, 0)
        normal = np.cross(second - first, third - first)
        with np.errstate(divide="ignore", invalid="ignore"):
            ranges = ((first - poses.translations) * normal).sum(axis=1) / (directions * normal).sum(axis=1)
        seen &= (ranges > NEAREST_M) & (ranges < self.reach_m)
        noise = np.random.default_rng([seed, 5]).normal(0, self.noise_m, count)
        return TimedPoints(times_ns[seen], (ranges[seen] + noise[seen])[:, None] * beams[seen])


def true_path(pose_at: Callable[[int], Pose], start_ns: int, end_ns: int) -> Trajectory:
    """world_from_rig, densely."""
    times_ns = np.arange(start_ns, end_ns + SAMPLE_NS, SAMPLE_NS)
    return Trajectory.of([(t, pose_at(t)) for t in times_ns.tolist()])


@dataclass(frozen=True, kw_only=True)
class SimulatedLaser(SensorFaults):
    """A level two-dimensional laser scanner that sees all around, as on a small robot."""

    name: ClassVar[str] = "laser"
    rate_hz: Annotated[float, Range(1, 50)] = 5.0
    """Scans per second."""
    points: Annotated[int, Range(20, 10_000)] = 720
    """Beams of a scan."""
    noise_m: Annotated[float, Range(0, 10)] = 0.02
    """Standard deviation of a range [m]."""
    reach_m: Annotated[float, Range(1, 300)] = 30.0
    """Farther points are not measured [m]."""
    arm_m: Annotated[float, Range(-10, 10)] = 0.3
    """Lever arm: how far the scanner is below the rig's origin [m]."""

    def sensor(self) -> LaserScanner:
        pose = Pose(LEVEL_FROM_VEHICLE, np.array([0.0, self.arm_m, 0.0]))
        return LaserScanner(rig_from_sensor=pose, range_noise_m=max(self.noise_m, 1e-3))

    def measured(self, scenery: Scenery) -> Iterator[Measurement]:
        rate = self.points * self.rate_hz
        pose = self.sensor().rig_from_sensor
        scanner = Profiler(rate, self.rate_hz, self.reach_m, self.noise_m, pose)
        for k, (start_ns, end_ns) in enumerate(pairwise(scenery.times_ns(self.rate_hz).tolist())):
            if not (self.works(scenery, start_ns) and self.works(scenery, end_ns)):
                continue
            seen = scanner.scan(scenery.scene(), scenery.pose_at, start_ns, end_ns, 100_003 * scenery.seed + k)
            points = TimedPoints(self.stamps_ns(seen.times_ns), seen.xyz_in_laser)
            yield LaserScan(int(self.stamps_ns(np.array([end_ns]))[0]), points, self.name)


# Files.


def sweeps(times_ns: NDArray[np.int64], xyz: Array) -> NDArray[np.intp]:
    """Returns the scan (N,) of each point (N, 3), from 0 on; points are in the order of time, in the scanner's frame.

    A scan ends where the azimuth turns back against the direction of the beams, or after a pause. So one that sees to
    the back, along -x, is in two parts there.
    """
    azimuth = np.arctan2(xyz[:, 1], xyz[:, 0])
    step = np.diff(azimuth)
    forward = np.sign(np.median(np.sign(step[step != 0]))) if step.any() else 0.0
    ends = (step * forward < -BACK_RAD) | (np.diff(times_ns) > PAUSE_NS)
    return np.concatenate([[0], np.cumsum(ends)]).astype(np.intp)


def readings_of_points(points: TimedPoints) -> Readings:
    """Returns the scans of points with times."""
    order = np.argsort(points.times_ns, kind="stable")
    times_ns, xyz = points.times_ns[order], points.xyz_in_laser[order]
    scan = sweeps(times_ns, xyz)
    ends_ns = times_ns[np.append(np.flatnonzero(np.diff(scan)), len(scan) - 1)]
    return Readings("laser", ends_ns, _values(xyz, scan, ends_ns[scan] - times_ns))


def readings_of_ranges(table: Table, options: FileOptions) -> Readings:
    """Returns the scans of a table with a row for each, whose columns are beams, named by their azimuths [deg].

    Times are those of the first beam. A range that is not positive is none.
    """
    angles = np.radians([_angle_deg(table.path, name) for name in table.columns])
    ranges = np.stack(list(table.columns.values()), axis=1)
    scan, beam = np.nonzero(ranges > 0)
    directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))], axis=1)
    left_ns = np.rint(1e9 * options.scan_s * np.linspace(1, 0, len(angles))).astype(np.int64)
    values = _values(ranges[scan, beam, None] * directions[beam], scan, left_ns[beam])
    return Readings("laser", table.times_ns + round(1e9 * options.scan_s), values)


def _values(xyz: Array, scan: NDArray[np.int64], before_ns: NDArray[np.int64]) -> dict[str, Array]:
    """Values of readings: of each point its place (P, 3), its scan (P,), not decreasing, and by how much it was
    measured before that one's end (P,)."""
    return {"xyz": xyz, "scan": scan.astype(float), "before_ns": before_ns.astype(float)}


def _angle_deg(path: Path, name: str) -> float:
    try:
        angle_deg = float(name)
    except ValueError:
        angle_deg = np.nan
    if not abs(angle_deg) <= 360:
        raise InputError(
            f"{path} has the column {name[:40]!r}, which is no angle of a beam [deg]: name beams by their angles, or "
            "give points with the columns x, y, z [m]"
        )
    return angle_deg


# What is observed between two nodes.


def laser_link(before: Array, now: Array, predicted: Pose, scanner: LaserScanner) -> Link | None:
    """Returns the motion of the rig that brings two scans (N, 3), (M, 3), in the scanner's frame, onto each other.

    `predicted` is rig_before_from_rig_now. None where too few points are matched.
    """
    import small_gicp

    placed = scanner.rig_from_sensor
    start = placed.inverse() @ predicted @ placed
    walls = [(scan[:, None] + LAYERS_M[:, None] * np.array([0.0, 0.0, 1.0])).reshape(-1, 3) for scan in (before, now)]
    if min(len(before), len(now)) < FEWEST_MATCHED:
        return None
    found = small_gicp.align(
        *walls,
        init_T_target_source=start.matrix,
        downsampling_resolution=0.1,
        max_correspondence_distance=REACH_M,
        num_threads=1,
    )
    if not found.converged or found.num_inliers < FEWEST_MATCHED * len(LAYERS_M):
        return None
    pose = Pose.from_matrix(found.T_target_source)
    plane = [3, 4, 2]  # x, y and the rotation about z of (phi, rho)
    unit = GICP_PER_M2 * 2 * scanner.range_noise_m**2 * len(LAYERS_M) * CORRELATED
    information = np.asarray(found.H)[np.ix_(plane, plane)] / unit
    level = np.linalg.inv(information + np.diag([FREE_M**-2, FREE_M**-2, FREE_RAD**-2]))
    covariance = np.diag([FLOOR_M**2, FLOOR_M**2, FREE_M**2, FREE_RAD**2, FREE_RAD**2, FLOOR_RAD**2])
    covariance[np.ix_([0, 1, 5], [0, 1, 5])] += level
    turn = pose.rotvec * np.array([0.0, 0.0, 1.0])
    flat = Pose.from_rotvec(turn, pose.translation * np.array([1.0, 1.0, 0.0]))
    return link_in_rig(flat, covariance, placed)


def deskewed(
    xyz: Array, times_ns: NDArray[np.int64], time_ns: int, path: Sequence[tuple[int, Pose]], rig_from_laser: Pose
) -> Array:
    """Returns points (N, 3) in the scanner's frame at one time, of points measured while the rig moved along a path.

    `path`: poses of the rig [m] around both. Points at times outside it are skipped.
    """
    now = between(path, time_ns)
    knots = [(t, pose) for t, pose in path]
    if now is None or len(knots) < 2:
        return xyz
    laser_now = (now @ rig_from_laser).inverse()
    out = list[Array]()
    for (start_ns, start), (end_ns, end) in pairwise(knots):
        inside = (times_ns >= start_ns) & (times_ns < end_ns)
        if not inside.any():
            continue
        first, last = laser_now @ start @ rig_from_laser, laser_now @ end @ rig_from_laser
        share = ((times_ns[inside] - start_ns) / (end_ns - start_ns))[:, None]
        out.append((1 - share) * first.apply(xyz[inside]) + share * last.apply(xyz[inside]))
    return np.concatenate(out) if out else np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class Scans:
    """The scan that waits for a node, and that of the last node."""

    waiting: LaserScan | None = None
    last: Array | None = None
    """(N, 3) in the scanner's frame, at the time of the last node."""
    straight: bool = False
    """Whether the last one was straightened by the motion within it."""


class LaserKind(SensorKind):
    """A level laser scanner or a profiler."""

    name, label, phrase, order = "laser", "Laser", "a laser scanner", 4
    sensor, measurement, simulated = LaserScanner, LaserScan, SimulatedLaser
    takes_points = True
    rates = Rates((0.5, 200.0), (1.0, 100.0))
    measures, needs = "relative", ("small_gicp",)

    def readings_of_points(self, points: TimedPoints) -> Readings:
        return readings_of_points(points)

    def readings(self, table: Table, options: FileOptions) -> Readings:
        return readings_of_ranges(table, options)

    def collected(self, measured: Sequence[Any]) -> Readings:
        """Returns the times of scans: their points stay where they are."""
        return Readings(self.name, np.array([scan.time_ns for scan in measured], np.int64))

    def measurements(self, found: Readings, frames_ns: NDArray[np.int64], name: str) -> Iterator[Measurement]:
        first = np.searchsorted(found.values["scan"], np.arange(len(found) + 1))
        for i in np.flatnonzero(found.within(frames_ns)).tolist():
            of_scan, time_ns = slice(first[i], first[i + 1]), int(found.times_ns[i])
            times_ns = time_ns - found.values["before_ns"][of_scan].astype(np.int64)
            yield LaserScan(time_ns, TimedPoints(times_ns, found.values["xyz"][of_scan]), name)

    def remembered(self, memory: Any, measurement: Any, oldest_ns: int) -> Any:
        return replace(memory or Scans(), waiting=measurement)

    def observed(self, memory: Any, at: NodeContext) -> tuple[Link | None, Any]:
        memory = memory or Scans()
        scan = memory.waiting
        if at.last is None or scan is None or not len(scan.points):
            return None, Scans()
        if not at.started and "wheel" in at.kinds:
            return None, Scans()  # wheels give the scale; scans that the motion has skewed would only disturb
        scanner, path = at.sensor(LaserScanner), list[tuple[int, Pose]]()
        if at.started:
            scale, since_ns = at.last.log_scale, at.time_ns - PATH_NS
            path = [(t, at.in_rig(pose, scale)) for t, pose in at.path if t > since_ns]
        now = deskewed(scan.points.xyz_in_laser, scan.points.times_ns, at.time_ns, path, scanner.rig_from_sensor)
        after = Scans(None, now, at.started)
        if memory.last is None or memory.straight != at.started:
            return None, after
        predicted = at.moved if at.moved is not None else Pose()
        if at.started:
            return laser_link(memory.last, now, predicted, scanner), after
        link = laser_link(memory.last, now, Pose(predicted.rotation), scanner)
        return link and replace(link, covariance=SKEWED * link.covariance), after

    def factors(self, before: Node | None, now: Node, frames: GraphFrames) -> list[Factor]:
        link = now.relative.get(self.name)
        return [] if before is None or link is None else [frames.relative_pose(self.name, link, before, now)]


KIND = LaserKind()
