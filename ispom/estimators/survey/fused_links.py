"""What `fused` measured between two nodes, in numbers of one kind: relative poses of the rig, fixes, and samples.

A node is a time at which the graph has a pose. Wheels and laser scans become relative poses with covariances; those of
motions in the plane leave height, roll and pitch nearly free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.types import ImuSamples, LaserScanner, WheelIncrement, WheelOdometer

OUT_OF_PLANE = 0.02
"""Standard deviation of height relative to the way, and of roll and pitch [rad], within a link of wheels: of a vehicle
on an uneven road."""
SIDEWAYS = 0.01
"""The same of the sideways motion of wheels that roll."""
FLOOR_M, FLOOR_RAD = 2e-3, 1e-3
"""Smallest standard deviations of a link [m], [rad]: of a standing platform."""
FREE_M, FREE_RAD = 1.0, 0.1
"""What a level laser scanner does not measure."""
LAYERS_M = np.array([-0.5, 0.0, 0.5])
"""A scan of one level is matched as walls: points are repeated at these heights."""
GICP_PER_M2 = 500.0
"""Information that small_gicp gives one point along the normal of its wall [1/m^2]: 1 / (2 * 1e-3)."""
MATCHES = 3.0
"""Neighbouring points of a scan err alike (the wall is uneven): factor of the covariance."""
REACH_M = 1.0
"""Points of two scans are matched within this distance."""
SLIP_SIGMAS = 3.0
"""What so many standard deviations of the wheels explain is no slip."""
FEWEST_MATCHED = 60
LONGEST_GAP_S = 0.15
"""An IMU without a sample for longer has an outage."""


@dataclass(frozen=True, eq=False)
class Link:
    """A measured motion from one node to the next."""

    relative: Pose
    """rig_before_from_rig_now; with the images of a `scaled` link, camera_before_from_camera_now."""
    covariance: Array
    """(6, 6) of the twist (rho, phi) on its right."""


@dataclass(frozen=True, eq=False)
class Fix:
    """The position of an antenna, near the time of a node."""

    xyz_in_local: Array
    covariance: Array
    antenna_in_rig: Array
    """(3,)"""
    camera_from_then: Pose
    """The camera of the node from the camera at the time of the fix, in the unit of the images."""


@dataclass(frozen=True, eq=False)
class Inertial:
    """Samples of an IMU from one node to the next, as intervals of constant values."""

    seconds: Array
    """(N,) lengths of the intervals."""
    rates: Array
    """(N, 3) [rad/s]."""
    forces: Array
    """(N, 3) [m/s^2]."""


def inertial_link(batches: Sequence[ImuSamples], start_ns: int, end_ns: int) -> Inertial | None:
    """Returns what an IMU measured from one time to another; None where it has an outage."""
    if not batches:
        return None
    times = np.concatenate([b.times_ns for b in batches])
    values = np.concatenate([np.hstack([b.angular_velocity_rad_s, b.specific_force_m_s2]) for b in batches])
    inside = (times > start_ns) & (times < end_ns)
    near = times[(times >= start_ns - 1e9 * LONGEST_GAP_S) & (times <= end_ns + 1e9 * LONGEST_GAP_S)]
    if not len(near) or np.diff([min(start_ns, near[0]), *near, max(end_ns, near[-1])]).max() > 1e9 * LONGEST_GAP_S:
        return None
    knots = np.concatenate([[start_ns], times[inside], [end_ns]])
    at = np.stack([np.interp(knots, times, column) for column in values.T], axis=1)
    middle = 0.5 * (at[1:] + at[:-1])
    return Inertial(np.diff(knots) * 1e-9, middle[:, :3], middle[:, 3:])


def wheel_link(
    increments: Sequence[WheelIncrement], start_ns: int, end_ns: int, odometer: WheelOdometer, turned: float | None
) -> tuple[Link, float] | None:
    """Returns the motion of the rig by its wheels, and their way [m]; None where they did not measure all the time.

    `turned`: rotation about the axis of the wheels [rad], where one wheel is measured only.
    """
    pose, covered_ns, way, known = Pose(), 0, 0.0, True
    for n, each in enumerate(increments):
        length = each.time_ns - each.since_ns
        # The last increment goes on to the node: the next one is not measured yet.
        late = n == len(increments) - 1 and 0 < end_ns - each.time_ns <= 1.5 * length
        overlap = (end_ns if late else min(end_ns, each.time_ns)) - max(start_ns, each.since_ns)
        if overlap <= 0:
            continue
        share = overlap / (each.time_ns - each.since_ns)
        known &= each.turned_rad is not None
        rate = (turned or 0.0) * overlap / (end_ns - start_ns)
        turn = rate if each.turned_rad is None else share * each.turned_rad
        half = Pose.from_rotvec(np.array([0.0, 0.0, 0.5 * turn]), np.zeros(3))
        pose = pose @ half @ Pose(translation=np.array([share * each.distance_m, 0.0, 0.0])) @ half
        covered_ns += overlap
        way += share * each.distance_m
    if covered_ns < 0.95 * (end_ns - start_ns) or (not known and turned is None):
        return None
    length = abs(way)
    turn_variance = FREE_RAD**2 if not known else odometer.rotation_noise_rad**2 * length + FLOOR_RAD**2
    variances = [
        odometer.distance_noise**2 * length + FLOOR_M**2,
        (SIDEWAYS * length) ** 2 + 0.25 * turn_variance * way**2 * known + FLOOR_M**2,
        (OUT_OF_PLANE * length) ** 2 + FLOOR_M**2,
        OUT_OF_PLANE**2,
        OUT_OF_PLANE**2,
        turn_variance,
    ]
    return in_rig(pose, np.diag(variances), odometer.rig_from_sensor), way


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
    unit = GICP_PER_M2 * 2 * scanner.range_noise_m**2 * len(LAYERS_M) * MATCHES
    information = np.asarray(found.H)[np.ix_(plane, plane)] / unit
    level = np.linalg.inv(information + np.diag([FREE_M**-2, FREE_M**-2, FREE_RAD**-2]))
    covariance = np.diag([FLOOR_M**2, FLOOR_M**2, FREE_M**2, FREE_RAD**2, FREE_RAD**2, FLOOR_RAD**2])
    covariance[np.ix_([0, 1, 5], [0, 1, 5])] += level
    turn = pose.rotvec * np.array([0.0, 0.0, 1.0])
    flat = Pose.from_rotvec(turn, pose.translation * np.array([1.0, 1.0, 0.0]))
    return in_rig(flat, covariance, placed)


def in_rig(relative: Pose, covariance: Array, rig_from_sensor: Pose) -> Link:
    """Returns a motion of a sensor, with its covariance, as that of the rig."""
    along = rig_from_sensor.adjoint
    return Link(rig_from_sensor @ relative @ rig_from_sensor.inverse(), along @ covariance @ along.T)


def between(poses: Sequence[tuple[int, Pose]], time_ns: int) -> Pose | None:
    """Returns the pose at a time within a path of poses, in the order of time; None outside it."""
    for (start_ns, start), (end_ns, end) in pairwise(poses):
        if start_ns <= time_ns <= end_ns:
            return start @ Pose.exp((time_ns - start_ns) / (end_ns - start_ns) * (start.inverse() @ end).log())
    return None


def deskewed(
    xyz: Array, times_ns: NDArray[np.int64], time_ns: int, path: Sequence[tuple[int, Pose]], rig_from_laser: Pose
) -> Array:
    """Returns points (N, 3) in the scanner's frame at one time, of points measured while the rig moved along a path.

    `path`: poses of the rig [m] around both. Points at times outside it are left out.
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
