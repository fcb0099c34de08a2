"""What `fused` keeps from frame to frame, and how its next node comes from what the sensors measured until then."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ispom.estimators.survey.fused_factors import GRAVITY_M_S2
from ispom.estimators.survey.fused_links import (
    SLIP_SIGMAS,
    Fix,
    Inertial,
    Link,
    between,
    deskewed,
    inertial_link,
    laser_link,
    wheel_link,
)
from ispom.estimators.survey.fused_start import summed
from ispom.estimators.survey.fused_values import Node, Prior
from ispom.geometry import Array, Pose
from ispom.persistent_list import PersistentList
from ispom.types import (
    GnssFix,
    ImuSamples,
    Kind,
    LaserScan,
    LaserScanner,
    Measurement,
    Rig,
    Status,
    Step,
    WheelIncrement,
    WheelOdometer,
)

WAITING_FIXES = 50
RECENT = 150
"""Poses of the images that are kept."""
SKEWED = 25.0
"""Factor of the covariance of scans before the start, which the motion within a scan has skewed."""
KEPT_NS = 500_000_000
"""Measurements are kept until they are older than the last node by this."""


@dataclass(frozen=True, eq=False)
class FusedState:
    """The window, what waits for its next node, and what left it."""

    sensors: frozenset[Kind] = frozenset()
    nodes: tuple[Node, ...] = ()
    prior: Prior | None = None
    """None until the start."""
    covariance: Array | None = None
    """(6, 6) of the last node's pose."""
    seen: tuple[tuple[int, Pose], ...] = ()
    """(time_ns, world_from_camera) of recent images, as known now."""
    samples: tuple[ImuSamples, ...] = ()
    increments: tuple[WheelIncrement, ...] = ()
    scan: LaserScan | None = None
    walls: Array | None = None
    """Points of the scan of the last node, at its time."""
    fixes: tuple[GnssFix, ...] = ()
    first: Prior | None = None
    """That of the start."""
    settled: PersistentList[Node] = PersistentList()
    """Nodes that left the window."""
    frames: PersistentList[tuple[int, int, Pose]] = PersistentList()
    """(time_ns, number of the node before, camera_of_node_from_camera) of all frames with a pose."""
    last_ns: int | None = None
    number: int = 0
    """Of the next node."""
    fresh: bool = False
    """The images began anew since the last node."""


def ahead(last: Node, inertial: Inertial, rig_from_body: Pose) -> tuple[Pose, Array]:
    """Returns local_from_rig and the velocity of the body (3,) after what an IMU measured since a node."""
    body = last.local_from_rig @ rig_from_body
    turn, faster, place, seconds = summed(inertial, last.bias)
    gravity = np.array([0.0, 0.0, -GRAVITY_M_S2])
    moved = body.rotation @ place + last.velocity * seconds + 0.5 * seconds**2 * gravity
    pose = Pose(body.rotation @ turn, body.translation + moved) @ rig_from_body.inverse()
    return pose, last.velocity + body.rotation @ faster + seconds * gravity


class Collector:
    """Keeps measurements, and makes nodes of them."""

    def __init__(
        self, rig: Rig, sensors: frozenset[Kind], camera_from_rig: Pose, rig_from_body: Pose, slip: float
    ) -> None:
        self._rig, self._sensors, self._slip = rig, sensors, slip
        self._camera_from_rig, self._rig_from_body = camera_from_rig, rig_from_body

    def in_rig(self, relative: Pose, log_scale: float) -> Pose:
        """Returns a motion of the camera in the unit of the images as one of the rig [m]."""
        return self._camera_from_rig.inverse() @ relative.scaled(np.exp(log_scale)) @ self._camera_from_rig

    def waiting(self, state: FusedState, measurement: Measurement) -> FusedState:
        """Keeps what a sensor of the scheme measured."""
        if measurement.kind not in self._sensors:
            return state
        start_ns = state.nodes[-1].time_ns if state.nodes else measurement.time_ns
        oldest = min(start_ns, measurement.time_ns) - 500_000_000
        if isinstance(measurement, ImuSamples):
            kept = tuple(s for s in state.samples if s.time_ns >= oldest)
            return replace(state, samples=(*kept, measurement))
        if isinstance(measurement, WheelIncrement):
            rolled = tuple(s for s in state.increments if s.time_ns >= oldest)
            return replace(state, increments=(*rolled, measurement))
        if isinstance(measurement, LaserScan):
            return replace(state, scan=measurement)
        if isinstance(measurement, GnssFix):
            return replace(state, fixes=(*state.fixes, measurement)[-WAITING_FIXES:])
        return state

    def with_images(self, state: FusedState, visual: Step) -> FusedState:
        """Keeps the poses of the images, as the visual method revised them."""
        seen = {} if visual.restarted else dict(state.seen)
        known = seen.keys() | {visual.time_ns}
        seen |= {t: pose for t, pose in visual.revised.items() if t in known or not state.seen}
        if visual.world_from_frame is not None and visual.status is Status.TRACKING:
            seen[visual.time_ns] = visual.world_from_frame
        fresh = state.fresh or visual.restarted
        return replace(state, seen=tuple(sorted(seen.items()))[-RECENT:], fresh=fresh)

    def next_node(self, state: FusedState, time_ns: int) -> tuple[FusedState, Node, float | None]:
        """Returns what waits after a new node, the node, and by which share its wheels disagree with the images."""
        path = state.seen
        camera = dict(path).get(time_ns)
        if not state.nodes:
            node = Node(state.number, time_ns, camera=camera, fixes=self._fixes(state, path, time_ns, camera, 0.0))
            return replace(state, number=state.number + 1, fixes=(), scan=None), node, None
        last = state.nodes[-1]
        # The images may have revised where they were at the last node.
        start = dict(path).get(last.time_ns)
        visual = start.inverse() @ camera if start is not None and camera is not None else None
        inertial = inertial_link(state.samples, last.time_ns, time_ns) if "imu" in self._sensors else None
        known = state.prior is not None
        moved = self.in_rig(visual, last.log_scale) if visual is not None else None
        wheel, way, apart = self._wheel(state, time_ns, moved, known)
        walls, laser = self._laser(state, time_ns, moved, last.log_scale if known else None)
        node = Node(
            state.number,
            time_ns,
            log_scale=last.log_scale,
            bias=last.bias,
            camera=camera,
            visual=visual,
            fresh=state.fresh or (camera is not None and last.camera is None and visual is None),
            inertial=inertial,
            wheel=wheel,
            way_m=way,
            slipped=apart is not None and apart > self._slip,
            laser=laser,
            fixes=self._fixes(state, path, time_ns, camera, last.log_scale),
        )
        if known:
            node = self._predicted(last, node, moved)
        waiting = tuple(f for f in state.fixes if f.time_ns > time_ns)
        after = replace(state, number=state.number + 1, fixes=waiting, scan=None, walls=walls, fresh=False)
        return after, node, apart

    def _predicted(self, last: Node, node: Node, moved: Pose | None) -> Node:
        """Returns the node with a first estimate from the last one."""
        seconds = (node.time_ns - last.time_ns) * 1e-9
        body = last.local_from_rig @ self._rig_from_body
        velocity = last.velocity
        inertial = None
        if node.inertial is not None:
            inertial, velocity = ahead(last, node.inertial, self._rig_from_body)
        if moved is not None:
            pose = last.local_from_rig @ moved
        elif node.wheel is not None or node.laser is not None:
            link = node.wheel if node.wheel is not None and not node.slipped else node.laser or node.wheel
            assert link is not None
            pose = last.local_from_rig @ link.relative
        elif inertial is not None:
            pose = inertial
        else:
            pose = last.local_from_rig
        if node.inertial is None:
            velocity = ((pose @ self._rig_from_body).translation - body.translation) / seconds
        return replace(node, local_from_rig=pose, velocity=velocity)

    def _fixes(
        self, state: FusedState, path: tuple[tuple[int, Pose], ...], time_ns: int, camera: Pose | None, log_scale: float
    ) -> tuple[Fix, ...]:
        found = list[Fix]()
        for fix in state.fixes:
            then = between(path, fix.time_ns)
            if fix.time_ns > time_ns or (camera is not None and then is None):
                continue
            antenna, late_s = self._rig.rig_from(fix.sensor).translation, (time_ns - fix.time_ns) * 1e-9
            covariance, relative = fix.covariance, Pose()
            if camera is not None and then is not None:
                relative = camera.inverse() @ then
            elif state.nodes:
                last = state.nodes[-1]
                speed = last.local_from_rig.rotation.T @ last.velocity * np.exp(-log_scale)
                relative = Pose(translation=-late_s * (self._camera_from_rig.rotation @ speed))
                covariance = covariance + np.eye(3) * (0.2 * late_s * float(np.linalg.norm(last.velocity))) ** 2
            found.append(Fix(fix.xyz_in_local, covariance, antenna, relative))
        return tuple(found)

    def _wheel(
        self, state: FusedState, time_ns: int, moved: Pose | None, known: bool
    ) -> tuple[Link | None, float, float | None]:
        """Returns the motion by wheels, their way, and by which share of it they disagree with the images."""
        odometer = next((s for s in self._rig.sensors.values() if isinstance(s, WheelOdometer)), None)
        if "wheel" not in self._sensors or odometer is None:
            return None, 0.0, None
        by_images = None
        if moved is not None:
            by_images = odometer.rig_from_sensor.inverse() @ moved @ odometer.rig_from_sensor
        turned = None if by_images is None else float(by_images.rotvec[2])
        found = wheel_link(state.increments, state.nodes[-1].time_ns, time_ns, odometer, turned)
        if found is None:
            return None, 0.0, None
        link, way = found
        if by_images is None or not known:
            return link, way, None
        # A standing rig: what the deviations explain is no slip.
        length = float(by_images.translation[0])
        least = SLIP_SIGMAS * np.hypot(odometer.distance_noise * np.sqrt(max(abs(length), 0.01)), 0.002)
        gap = max(0.0, abs(way - length) - least)
        return link, way, gap / max(abs(length), abs(way), 0.02)

    def _laser(
        self, state: FusedState, time_ns: int, moved: Pose | None, log_scale: float | None
    ) -> tuple[Array | None, Link | None]:
        """Returns the scan at the time of the node, and the motion since the scan of the last node."""
        scan, walls = state.scan, state.walls
        scanner = next((s for s in self._rig.sensors.values() if isinstance(s, LaserScanner)), None)
        if "laser" not in self._sensors or scanner is None or scan is None or not len(scan.points):
            return None, None
        if log_scale is None and "wheel" in self._sensors:
            return None, None  # wheels give the scale; scans that the motion has skewed would only disturb
        path = list[tuple[int, Pose]]()
        if log_scale is not None:
            path = [(t, self.in_rig(pose, log_scale)) for t, pose in state.seen if t > time_ns - 3 * KEPT_NS]
        now = deskewed(scan.points.xyz_in_laser, scan.points.times_ns, time_ns, path, scanner.rig_from_sensor)
        if walls is None:
            return now, None
        predicted = moved if moved is not None else Pose()
        if log_scale is not None:
            return now, laser_link(walls, now, predicted, scanner)
        link = laser_link(walls, now, Pose(predicted.rotation), scanner)
        return now, link and Link(link.relative, SKEWED * link.covariance)
