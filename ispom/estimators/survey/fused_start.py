"""The start of `fused`: the pose of the images' world in the local frame, and the length of its unit.

Up comes from the mean specific force of the IMU, or from the first pose of the rig, which is assumed level then. Scale
and heading come from the fixes (a similarity in the plane). Without fixes, the scale comes from wheels or scans (ratios
of lengths), or from the IMU alone: the linear alignment of Qin, Li and Shen (VINS-Mono, 2018, section V.B) for
velocities, gravity and scale.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ispom.estimators.survey.fused_checks import ALIGNED, START_FIXES, START_WAY
from ispom.geometry import Array, Pose, so3_exp, so3_log
from ispom.sensors.fusion import Node
from ispom.sensors.gnss import Fix, fixes_of
from ispom.sensors.imu import GRAVITY_M_S2, inertial_of, summed
from ispom.types import Decision

OPTICAL_FROM_LEVEL = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Right, down, ahead of right (east), ahead (north), up."""
UNCERTAIN_UNIT = 0.005
"""Relative standard deviation of the unit of a pair whose calibration does not say how certain it is: of a baseline of
0.2 m that is known to a millimetre."""
CERTAIN_UNIT = 1e-4
"""The same if the calibration states its accuracy (`pair_sigma`): the covariances of the images include the uncertainty
of the unit then, and this value only keeps equations solvable."""
FEWEST_FIXES = 4
SPREAD = 10.0
"""Least distance of a fix from the first one, in standard deviations of the fixes."""
WHEEL_WAY_M = 1.0
"""Way of the wheels or scans that gives the scale."""
INERTIAL_S = 2.5
"""Time with IMU samples from which on they may give the scale."""
MAX_SCALE_SIGMA = 0.1
"""Largest relative standard deviation of a scale from the IMU alone."""
GRAVITY_OFF = 0.15
"""Share by which its gravity may differ from 9.81 m/s^2."""

REST_S, REST_PX, FEWEST_RESTING = 1.0, 1.0, 8
"""A rig stands where points moved by at most REST_PX (median) within REST_S; at least FEWEST_RESTING must be seen."""


@dataclass(frozen=True, eq=False)
class Start:
    """The first estimate, with standard deviations of the first node."""

    nodes: tuple[Node, ...]
    scale_sigma: float


def started(
    nodes: tuple[Node, ...],
    camera_from_rig: Pose,
    rig_from_body: Pose,
    gnss: bool,
    unit_sigma: float | None,
    start_m: float,
) -> Start | None:
    """Returns nodes with first estimates; None while too little was measured.

    All of `nodes` have a pose of the images. `gnss`: fixes take part. `unit_sigma`: relative standard
    deviation of the images' unit where that is the metre; None where it is any.
    """
    frames, metric = (camera_from_rig, rig_from_body), unit_sigma is not None
    inertial = sum(inertial_of(n) is not None for n in nodes[1:]) >= max(1, 0.8 * (len(nodes) - 1))
    level_from_world = _level(nodes, camera_from_rig, rig_from_body, inertial)
    if gnss:
        found = _by_fixes(nodes, level_from_world, camera_from_rig, 1.0 if metric else None, start_m)
        return found and _placed(nodes, found, frames, 0.1 if unit_sigma is None else unit_sigma)
    scale: float | None = 1.0 if metric else _by_links(nodes, camera_from_rig)
    sigma = 0.3 if unit_sigma is None else unit_sigma
    if scale is None and inertial and not any(n.link for n in nodes):
        by_imu = _by_imu(nodes, camera_from_rig, rig_from_body)
        if by_imu is not None:
            scale, up, sigma = by_imu[0], by_imu[1], max(3 * by_imu[2], 0.1)
            level_from_world = _turn_to_up(up)
    if scale is None:
        return None
    return _placed(nodes, (scale, _ahead_is_north(nodes, level_from_world, camera_from_rig), None), frames, sigma)


def resting(nodes: tuple[Node, ...], camera_from_rig: Pose, rig_from_body: Pose, focal_px: float) -> Start | None:
    """Returns nodes with first estimates of a rig that stands: the mean specific force is up, the mean rate is bias.

    It stands where its IMU measured for REST_S, and its points stayed within REST_PX (their median). None where it does
    not. The scale is taken to be known; it has no meaning yet.
    """
    samples = [each for n in nodes[1:] if (each := inertial_of(n)) is not None]
    seconds = sum(float(s.seconds.sum()) for s in samples)
    if seconds < 0.99 * REST_S or len(samples) < len(nodes) - 1:
        return None
    for now in nodes[1:]:
        _, here, there = np.intersect1d(nodes[0].points.ids, now.points.ids, return_indices=True)
        moved = np.linalg.norm(nodes[0].points.xy[here] - now.points.xy[there], axis=1)
        if len(here) < FEWEST_RESTING or np.median(moved) * focal_px > REST_PX:
            return None
    force = sum(s.seconds @ s.forces for s in samples) / seconds
    bias = np.concatenate([np.zeros(3), sum(s.seconds @ s.rates for s in samples) / seconds])
    up = camera_from_rig.rotation @ rig_from_body.rotation @ force
    standing = tuple(replace(n, camera=Pose(), bias=bias) for n in nodes)
    rotation = _ahead_is_north(standing, _turn_to_up(up), camera_from_rig)
    start = _placed(standing, (1.0, rotation, None), (camera_from_rig, rig_from_body), UNCERTAIN_UNIT)
    return replace(start, nodes=tuple(replace(n, camera=was.camera) for n, was in zip(start.nodes, nodes, strict=True)))


def _level(nodes: tuple[Node, ...], camera_from_rig: Pose, rig_from_body: Pose, inertial: bool) -> Array:
    """Returns (3, 3) level_from_world: z up."""
    if inertial:
        total = np.zeros(3)
        for node in nodes[1:]:
            samples = inertial_of(node)
            if samples is not None and node.camera is not None:
                turn = node.camera.rotation @ camera_from_rig.rotation @ rig_from_body.rotation
                total += turn @ (samples.seconds @ samples.forces)
        return _turn_to_up(total)
    first = nodes[0].camera
    assert first is not None
    return _turn_to_up(first.rotation @ camera_from_rig.rotation @ np.array([0.0, -1.0, 0.0]))


def _turn_to_up(up: Array) -> Array:
    """Returns (3, 3) that turns a direction to z by the shortest way from the optical axes' level."""
    direction = OPTICAL_FROM_LEVEL.T @ (up / np.linalg.norm(up))
    axis = np.cross(direction, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(axis))
    angle = np.arctan2(sine, direction[2])
    return so3_exp(axis / max(sine, 1e-12) * angle) @ OPTICAL_FROM_LEVEL.T


def _ahead_is_north(nodes: tuple[Node, ...], level_from_world: Array, camera_from_rig: Pose) -> Array:
    """Returns (3, 3) local_from_world in which the first rig heads along y."""
    first = nodes[0].camera
    assert first is not None
    ahead = level_from_world @ first.rotation @ camera_from_rig.rotation @ np.array([0.0, 0.0, 1.0])
    return so3_exp(np.array([0.0, 0.0, np.arctan2(ahead[0], ahead[1])])) @ level_from_world


def fix_checks(nodes: tuple[Node, ...], start_m: float) -> tuple[Decision, ...]:
    """Returns whether the fixes are enough, and far enough from each other, for scale and heading."""
    fixes = [fix for n in nodes for fix in fixes_of(n)]
    enough = START_FIXES.of(len(fixes), FEWEST_FIXES)
    if not enough.passed:
        return (enough,)
    sigma = float(np.sqrt(np.mean([np.trace(fix.covariance[:2, :2]) / 2 for fix in fixes])))
    return enough, START_WAY.of(_extent(fixes), max(start_m, SPREAD * sigma))


def alignment(nodes: tuple[Node, ...], start_m: float, aligned: bool) -> Decision:
    """Returns whether a pair is aligned with the fixes."""
    fixes = [fix for n in nodes for fix in fixes_of(n)]
    return ALIGNED.of(_extent(fixes) if fixes else 0.0, start_m, passed=aligned)


def _extent(fixes: list[Fix]) -> float:
    """Returns the largest distance of a fix from the first one, in the plane [m]."""
    xy = np.array([fix.xyz_in_local[:2] for fix in fixes])
    return float(np.linalg.norm(xy - xy[0], axis=1).max())


def _by_fixes(
    nodes: tuple[Node, ...], level_from_world: Array, camera_from_rig: Pose, scale: float | None, start_m: float
) -> tuple[float, Array, Array] | None:
    """Returns scale, (3, 3) local_from_world and the local position of the images' origin, by a similarity."""
    if not all(check.passed for check in fix_checks(nodes, start_m)):
        return None
    rows = [(n, fix) for n in nodes for fix in fixes_of(n)]
    xyz = np.array([fix.xyz_in_local for _, fix in rows])
    thens = [n.camera @ fix.camera_from_then for n, fix in rows if n.camera is not None]
    cameras = np.array([level_from_world @ pose.translation for pose in thens])
    arms = np.array(
        [
            level_from_world @ pose.rotation @ camera_from_rig.apply(fix.antenna_in_rig)
            for pose, (_, fix) in zip(thens, rows, strict=True)
        ]
    )
    local, unit = xyz - xyz.mean(axis=0), scale or 1e9
    turn = 0.0
    for _ in range(10):
        seen = cameras + arms / unit
        x, y = (seen - seen.mean(axis=0))[:, :2].T
        dot, cross = x @ local[:, 0] + y @ local[:, 1], x @ local[:, 1] - y @ local[:, 0]
        turn = np.arctan2(cross, dot)
        if scale is None:
            unit = np.hypot(dot, cross) / (x @ x + y @ y)
    rotation = so3_exp(np.array([0.0, 0.0, turn])) @ level_from_world
    heading = so3_exp(np.array([0.0, 0.0, turn]))
    origin = (xyz - unit * cameras @ heading.T - arms @ heading.T).mean(axis=0)
    return float(unit), rotation, origin


def _by_links(nodes: tuple[Node, ...], camera_from_rig: Pose) -> float | None:
    """Returns the median ratio of the lengths of links to those of the images."""
    ratios, way = list[float](), 0.0
    for node in nodes[1:]:
        if node.link is None or node.visual is None:
            continue
        moved = camera_from_rig @ node.link.relative @ camera_from_rig.inverse()
        length = float(np.linalg.norm(node.visual.translation))
        way += float(np.linalg.norm(moved.translation))
        if length > 0:
            ratios.append(float(np.linalg.norm(moved.translation)) / length)
    return float(np.median(ratios)) if ratios and way >= WHEEL_WAY_M else None


def _by_imu(nodes: tuple[Node, ...], camera_from_rig: Pose, rig_from_body: Pose) -> tuple[float, Array, float] | None:
    """Returns scale, the direction up in the images' world, and the relative deviation of the scale."""
    steps = [(a, b, each) for a, b in pairwise(nodes) if (each := inertial_of(b)) is not None]
    if sum((b.time_ns - a.time_ns) * 1e-9 for a, b, _ in steps) < INERTIAL_S:
        return None
    camera_from_body = camera_from_rig @ rig_from_body
    arm = camera_from_body.translation
    turns = {n.number: n.camera.rotation @ camera_from_body.rotation for n in nodes if n.camera is not None}
    drift, total = np.zeros(3), 0.0
    for a, b, samples in steps:
        turned, _, _, seconds = summed(samples, np.zeros(6))
        drift += so3_log((turns[a.number].T @ turns[b.number]).T @ turned)
        total += seconds
    gyroscope_bias = drift / total
    count, index = len(nodes), {n.number: i for i, n in enumerate(nodes)}
    rows, side = list[Array](), list[Array]()
    for a, b, samples in steps:
        _, velocity, place, dt = summed(samples, np.concatenate([np.zeros(3), gyroscope_bias]))
        i, j, eye = 3 * index[a.number], 3 * index[b.number], np.eye(3)
        assert a.camera is not None and b.camera is not None
        row = np.zeros((6, 3 * count + 4))
        row[:3, -1] = b.camera.translation - a.camera.translation
        row[:3, i : i + 3], row[:3, -4:-1] = -dt * eye, -0.5 * dt**2 * eye
        row[3:, j : j + 3], row[3:, i : i + 3], row[3:, -4:-1] = dt * eye, -dt * eye, -(dt**2) * eye
        known = turns[a.number] @ place - (b.camera.rotation - a.camera.rotation) @ arm
        rows.append(row)
        side.append(np.concatenate([known, dt * turns[a.number] @ velocity]))
    matrix, vector = np.concatenate(rows), np.concatenate(side)
    solution, *_ = np.linalg.lstsq(matrix, vector, rcond=None)
    freedom = len(vector) - matrix.shape[1]
    if freedom <= 0:
        return None
    variance = ((matrix @ solution - vector) ** 2).sum() / freedom
    deviation = float(np.sqrt(variance * np.linalg.pinv(matrix.T @ matrix)[-1, -1]))
    scale, gravity = float(solution[-1]), solution[-4:-1]
    off = abs(np.linalg.norm(gravity) / GRAVITY_M_S2 - 1)
    if scale <= 0 or deviation > MAX_SCALE_SIGMA * scale or off > GRAVITY_OFF:
        return None
    return scale, -gravity, deviation / scale


def _placed(
    nodes: tuple[Node, ...], where: tuple[float, Array, Array | None], frames: tuple[Pose, Pose], sigma: float
) -> Start:
    """Puts the nodes into the local frame by scale, rotation and origin, with velocities by differences.

    `frames`: camera_from_rig and rig_from_body. Without an origin, the first rig is there.
    """
    (scale, local_from_world, origin), (camera_from_rig, rig_from_body) = where, frames
    poses = list[Pose]()
    for node in nodes:
        assert node.camera is not None
        placed = Pose(local_from_world @ node.camera.rotation, scale * (local_from_world @ node.camera.translation))
        poses.append(placed @ camera_from_rig)
    shift = -poses[0].translation if origin is None else origin
    poses = [Pose(pose.rotation, pose.translation + shift) for pose in poses]
    places = np.array([(pose @ rig_from_body).translation for pose in poses])
    times_s = np.array([(n.time_ns - nodes[0].time_ns) * 1e-9 for n in nodes])
    speeds = np.gradient(places, times_s, axis=0) if len(nodes) > 1 else np.zeros((1, 3))
    log_scale = float(np.log(scale))
    found = tuple(
        replace(n, local_from_rig=pose, velocity=speed, log_scale=log_scale)
        for n, pose, speed in zip(nodes, poses, speeds, strict=True)
    )
    return Start(found, sigma)
