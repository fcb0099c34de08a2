"""The other sensors of a bag: IMU, NavSatFix, wheel odometry; poses on the rig by tf_static or a camchain beside it.

An image's frame_id is taken for the optical frame of its camera (x right, y down, z ahead; REP 103), as sensor_msgs
asks for, unless its name is that of a body (camera_link). A topic of nav_msgs/Odometry is taken for wheels where its
name says so, or where it is called odom or odometry and has neither height, roll nor pitch at all: other odometry may
be the estimate of a camera, or the truth. Its child_frame_id has x ahead and z up (REP 105). Sources: ROS, the packages
sensor_msgs, nav_msgs and tf2_msgs.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.errors import InputError, counted
from ispom.geometry import Array, Pose
from ispom.io.bag_file import IMAGE_TYPES, INFO_TYPE, BagFile
from ispom.io.poses.dialects.ros_bag import TF, pose_topics
from ispom.io.values import LARGEST, MAX_TIME_S
from ispom.sensors.gnss import MAX_SIGMA, MIN_SIGMA, geodetic_values
from ispom.sensors.kind import Readings
from ispom.sequences.recorded_sensors import RecordedSensor, imu_origin
from ispom.sequences.sensor_discovery import NO_POSE, imu_noise_beside, imu_pose_beside, numbered
from ispom.types import Found, GnssAntenna, Imu, WheelOdometer

IMU, FIX, ODOMETRY = "sensor_msgs/msg/Imu", "sensor_msgs/msg/NavSatFix", "nav_msgs/msg/Odometry"
LASERS = ("sensor_msgs/msg/LaserScan", "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/MultiEchoLaserScan")
WHEELS = re.compile(r"wheel|encoder|diff_?drive|velocity_controller")
NAMED_ODOMETRY = re.compile(r"(^|/)odom(etry)?(/[a-z]*)?$")
OTHERWISE = re.compile(r"truth|gt|visual|camera|zed|slam|vio|lidar|laser|icp|vins|filter|fused|global|map|optimi[sz]ed")
"""What topics of odometry are called that are of no wheels alone."""
BODY = "_link"
"""How names of frames of bodies end (REP 103, 105): cameras whose images are in one may look along its x axis."""
FLAT = 1e-9
"""Odometry of wheels has no height, roll and pitch beyond it."""
USUAL_SIGMA_M = (5.0, 5.0, 10.0)
"""Of a receiver that states none, east, north and up: as of NMEA's fixes by GPS alone with an HDOP of 1."""
MOST_TRANSFORMS = 10_000


@dataclass(frozen=True, eq=False)
class BagCamera:
    """The left camera of the recording of a bag."""

    topic: str
    left_from_raw: Pose = field(default_factory=Pose)
    """Its raw images' frame in that of the left camera, as rectified."""
    own_clock: bool = False
    """Whether the times of its images are those at which messages were written."""


def sensors_of_bag(bag: BagFile, camera: BagCamera) -> tuple[tuple[RecordedSensor, ...], tuple[Found, ...]]:
    """Returns the IMU, receivers and wheels of a bag, and what else is in it and not used."""
    makers = {IMU: _imu, FIX: _receiver, ODOMETRY: _wheels}
    found, others, tree = list[RecordedSensor](), list[Found](), None
    for topic, kind in bag.types.items():
        if kind not in makers or not bag.holds(topic):
            continue
        try:
            tree = tree or _Frames.of(bag)
            found.append(makers[kind](bag, topic, camera, tree))
        except InputError as fault:
            what = {IMU: "imu", FIX: "gnss", ODOMETRY: "wheel"}[kind]
            others.append(Found(what, _where(bag, topic), False, f"is not used: {fault.args[0]}"))
    found.sort(key=lambda each: bool(each.missing))  # the usable one has the name of its kind
    poses = [topic for topic in pose_topics(bag) if "/tf" not in topic and bag.types[topic] != ODOMETRY]
    for topic in poses:
        why = "has poses: not used as ground truth, as their body need not be the camera; compare with them by "
        others.append(Found("poses", _where(bag, topic), False, f"{why}ispom evaluate {bag.path}:{topic} ESTIMATE"))
    for topic, kind in bag.types.items():
        if kind in LASERS:
            others.append(Found("laser", _where(bag, topic), False, "is not used: scans of bags are not read"))
        elif kind.startswith("sensor_msgs/") and kind not in (IMU, FIX, INFO_TYPE, *IMAGE_TYPES):
            why = f"is not used: {kind.rsplit('/', 1)[-1]} is not read"
            others.append(Found("other", _where(bag, topic), False, why))
    return numbered(found), tuple(others)


def _where(bag: BagFile, topic: str) -> str:
    return f"{bag.path.name}:{topic}"


# Poses on the rig.


@dataclass(frozen=True, eq=False)
class _Frames:
    """The tree of a bag's static transforms: the parent of each frame, and parent_from_frame."""

    parents: dict[str, tuple[str, Pose]] = field(default_factory=dict)

    @staticmethod
    def of(bag: BagFile) -> _Frames:
        parents = dict[str, tuple[str, Pose]]()
        for topic, kind in bag.types.items():
            if kind in TF and topic.rstrip("/").endswith("tf_static"):
                for message in bag.all_messages(topic, MOST_TRANSFORMS):
                    for each in message.transforms:
                        place, turn = each.transform.translation, each.transform.rotation
                        values = np.array([place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w], float)
                        if np.isfinite(values).all() and abs(np.linalg.norm(values[3:]) - 1) < 0.01:
                            pose = Pose.from_xyzw(values[3:], values[:3])
                            parents[_frame(each.child_frame_id)] = (_frame(each.header.frame_id), pose)
        return _Frames(parents)

    def between(self, to: str, frame: str) -> Pose | None:
        """Returns to_from_frame; None where the tree does not have both."""
        ends = [dict(self._upwards(each)) for each in (to, frame)]
        root = next((name for name in ends[0] if name in ends[1]), None)
        return None if root is None else ends[0][root].inverse() @ ends[1][root]

    def _upwards(self, frame: str) -> Iterator[tuple[str, Pose]]:
        """Yields each frame from one upwards, and its pose ANCESTOR_from_FRAME."""
        pose, seen = Pose(), set[str]()
        while frame not in seen:
            yield frame, pose
            seen.add(frame)
            if frame not in self.parents:
                return
            frame, step = self.parents[frame]
            pose = step @ pose


def _frame(name: str) -> str:
    return name.strip().removeprefix("/")


def _mount(bag: BagFile, topic: str, frame: str, camera: BagCamera, tree: _Frames) -> tuple[Pose | None, str]:
    """Returns left_from_FRAME by tf_static and what it is from; or None and why it is not known."""
    image = bag.message(camera.topic)
    optical = _frame(image.header.frame_id) if image is not None else ""
    for name, of in ((frame, topic), (optical, camera.topic)):
        if not name:
            return None, f"{of} has no frame_id"
    if optical.lower().endswith(BODY):
        body = f"the images of {camera.topic} are in {optical}, a name of a body (x ahead) and not of an optical frame"
        return None, f"{body} (z ahead), so that the camera's axes are not known"
    pose = tree.between(optical, frame)
    if pose is None:
        return None, f"tf_static has no way from {optical} to {frame}" if tree.parents else "the bag has no tf_static"
    return camera.left_from_raw @ pose, f"tf_static ({frame} in {optical})"


# The kinds of sensors.


def _imu(bag: BagFile, topic: str, camera: BagCamera, tree: _Frames) -> RecordedSensor:
    beside, read = (bag.path.resolve().parent,), partial(_imu_readings, bag, topic, camera.own_clock)
    pose, origin = _mount(bag, topic, _frame(bag.message(topic).header.frame_id), camera, tree)
    missing = ""
    try:
        noise, of_noise = imu_noise_beside(beside)
        chain = imu_pose_beside(beside, camera.topic)
    except InputError as fault:
        missing, noise, of_noise, chain = f"is not used: {fault.args[0]}", None, "", None
    later_ns = 0
    if chain is not None:  # calibrated: more exact than a drawing
        pose, later_ns, of_pose = camera.left_from_raw @ chain[0], chain[1], chain[2]
        origin = of_pose
    if pose is None:
        missing = missing or f"{NO_POSE} ({origin}; no camchain with T_cam_imu is beside the bag)"
        origin = ""
    sensor = replace(noise or Imu(), rig_from_sensor=pose or Pose())
    origin = imu_origin(origin, noise, of_noise)
    reading = partial(_shifted, read, later_ns)
    return RecordedSensor("imu", _where(bag, topic), sensor, reading, origin, missing, pose is not None)


def _receiver(bag: BagFile, topic: str, camera: BagCamera, tree: _Frames) -> RecordedSensor:
    first = bag.message(topic)
    pose, origin = _mount(bag, topic, _frame(first.header.frame_id), camera, tree)
    read = partial(_gnss_readings, bag, topic, camera.own_clock)
    missing = "" if pose is not None else f"{NO_POSE} ({origin})"
    origin = f"pose of {origin}"
    stated = all(variance > 0 for variance in _variances(first))
    if not stated:
        usual = " x ".join(f"{sigma:g}" for sigma in USUAL_SIGMA_M)
        origin = f"{origin}, its covariance is not stated: the usual standard deviations are taken ({usual} m)"
    antenna = GnssAntenna(rig_from_sensor=pose or Pose())
    return RecordedSensor("gnss", _where(bag, topic), antenna, read, origin, missing, pose is not None)


def _wheels(bag: BagFile, topic: str, camera: BagCamera, tree: _Frames) -> RecordedSensor:
    first = bag.message(topic)
    pose, origin = _mount(bag, topic, _frame(first.child_frame_id), camera, tree)
    where, read = _where(bag, topic), partial(_wheel_readings, bag, topic, camera.own_clock)
    name = topic.lower()
    missing = ""
    if not WHEELS.search(name):
        likely = bool(NAMED_ODOMETRY.search(name)) and not OTHERWISE.search(name)
        if not likely or not _is_flat(bag, topic):
            missing = (
                "is not used: nothing says that this odometry is of wheels, and no estimate or truth (compare with "
            )
            missing += f"it by ispom evaluate {bag.path}:{topic} ESTIMATE)"
        else:
            origin += ", taken for wheels as it has neither height, roll nor pitch"
    if not missing and pose is None:
        missing = f"{NO_POSE} ({origin})"
    usual = f"its noise is the usual one ({WheelOdometer.distance_noise:g} m and "
    usual += f"{WheelOdometer.rotation_noise_rad:g} rad within a metre)"
    odometer = WheelOdometer(rig_from_sensor=pose or Pose())
    return RecordedSensor("wheel", where, odometer, read, f"pose of {origin}, {usual}", missing, pose is not None)


def _is_flat(bag: BagFile, topic: str) -> bool:
    poses = [_pose_of(message) for message in bag.all_messages(topic)]
    values = np.array(poses)
    return bool(np.ptp(values[:, 2]) <= FLAT and np.abs(values[:, 3:5]).max() <= FLAT)


# Readings.


def _shifted(read: Callable[[], Readings], by_ns: int) -> Readings:
    found = read()
    return replace(found, times_ns=found.times_ns + by_ns)


def _rows(
    bag: BagFile, topic: str, own_clock: bool, row: Callable[[Any], list[float]]
) -> tuple[NDArray[np.int64], Array]:
    """Returns increasing times (N,) [ns] and values (N, K) of a topic's messages; those that are not finite are left
    out, and those of a time that another has. Raises InputError where none is left."""
    times, values = list[int](), list[list[float]]()
    for written_ns, message in bag.timed_messages(topic):
        stamp = message.header.stamp
        time_ns = stamp.sec * 10**9 + stamp.nanosec
        times.append(written_ns if own_clock or time_ns == 0 else time_ns)
        values.append(row(message))
    table = np.array(values, float).reshape(len(times), -1)
    stamps = np.array(times, np.int64)
    sound = (abs(table) <= LARGEST).all(axis=1) & (abs(stamps) <= MAX_TIME_S * 10**9)
    if not sound.any():
        raise InputError(f"{bag.path}: {topic} has no finite value in {counted(len(times), 'message')}: leave it out")
    times_ns, first = np.unique(stamps[sound], return_index=True)
    return times_ns, table[sound][first]


def _imu_readings(bag: BagFile, topic: str, own_clock: bool) -> Readings:
    def row(message: Any) -> list[float]:
        rate, force = message.angular_velocity, message.linear_acceleration
        return [rate.x, rate.y, rate.z, force.x, force.y, force.z]

    times_ns, values = _rows(bag, topic, own_clock, row)
    return Readings("imu", times_ns, {"rates": values[:, :3], "forces": values[:, 3:]})


def _gnss_readings(bag: BagFile, topic: str, own_clock: bool) -> Readings:
    def row(message: Any) -> list[float]:
        if message.status.status < 0:  # no fix
            return [np.nan] * 6
        sigma = [max(v, 0.0) ** 0.5 or usual for v, usual in zip(_variances(message), USUAL_SIGMA_M, strict=True)]
        return [message.latitude, message.longitude, message.altitude, *sigma]

    times_ns, values = _rows(bag, topic, own_clock, row)
    sigma = np.clip(values[:, 3:], MIN_SIGMA, MAX_SIGMA)
    return Readings("gnss", times_ns, geodetic_values(f"{bag.path}: {topic}", values[:, :3], sigma))


def _variances(message: Any) -> list[float]:
    """Of east, north and up [m^2]; 0 where they are not known."""
    return [float(v) if np.isfinite(v) else 0.0 for v in np.asarray(message.position_covariance, float)[[0, 4, 8]]]


def _pose_of(message: Any) -> list[float]:
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    return [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]


def _wheel_readings(bag: BagFile, topic: str, own_clock: bool) -> Readings:
    """Increments of poses in the plane: arcs along the x axis, and the turns about z."""
    times_ns, values = _rows(bag, topic, own_clock, _pose_of)
    if (abs(np.linalg.norm(values[:, 3:], axis=1) - 1) > 0.01).any():
        raise InputError(f"{bag.path}: {topic} has a quaternion that is not of length 1: leave it out")
    turned = Rotation.from_quat(values[:, 3:])
    steps = turned[:-1].inv().apply(np.diff(values[:, :3], axis=0))
    turns = (turned[:-1].inv() * turned[1:]).as_rotvec()[:, 2]
    chord = np.copysign(np.linalg.norm(steps[:, :2], axis=1), steps[:, 0])
    values = {"distances": chord / np.sinc(turns / (2 * np.pi)), "turns": turns}
    return Readings("wheel", times_ns, values, between=True)
