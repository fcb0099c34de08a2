"""A simulated recording as a bag, as robots record one: images, IMU, NavSatFix, wheel odometry, and tf_static."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ispom.geometry import Array, Pose
from ispom.types import GnssFix, ImuSamples, Measurement, Sequence, WheelIncrement, images_of

START_NS = 1_700_000_000_000_000_000
BASE_FROM_RIG = Pose.from_rotvec(np.array([-1.2, 1.21, -1.2]), np.array([0.4, -0.1, 1.3]))
"""Any: what is calibrated is the way from the camera to each sensor."""
ORIGIN = (49.0, 8.4, 116.0)
FRAMES = {"imu": "imu_link", "gnss": "gps_link", "wheel": "base_footprint"}


def write_bag(
    path: Path,
    sequence: Sequence,
    cameras: tuple[str, ...] = ("left", "right"),
    kind: str = "sqlite3",
    topics: Mapping[str, str] | None = None,
    tf: bool = True,
    info: bool = True,
    optical: str = "optical",
    extra: bool = False,
) -> Path:
    """Writes what a simulation measured; `topics` are those of imu, gnss and wheel. `extra` has a scan, a temperature
    and poses, too."""
    pytest.importorskip("rosbags", reason="the extra `bags` is not installed")
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    named = {"imu": "/imu/data", "gnss": "/gps/fix", "wheel": "/odom", **(topics or {})}
    ros1 = kind == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if ros1:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    types: Any = store.types
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    writer: Any = Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=plugin)
    connections: dict[str, Any] = {}

    def made(name: str, *values: Any) -> Any:
        return types[name](*values)

    def header(time_ns: int, frame: str) -> Any:
        stamp = made("builtin_interfaces/msg/Time", *divmod(time_ns, 10**9))
        return made("std_msgs/msg/Header", *((0,) if ros1 else ()), stamp, frame)

    def put(topic: str, name: str, time_ns: int, message: Any) -> None:
        if topic not in connections:
            connections[topic] = writer.add_connection(topic, name, typestore=store)
        raw = store.serialize_ros1(message, name) if ros1 else store.serialize_cdr(message, name)
        writer.write(connections[topic], time_ns, bytes(raw))

    def vector(values: Any) -> Any:
        return made("geometry_msgs/msg/Vector3", *map(float, values))

    def turn(pose: Pose) -> Any:
        return made("geometry_msgs/msg/Quaternion", *map(float, pose.xyzw))

    rig = sequence.rig
    with writer:
        transforms = []
        placed = {f"{name}_{optical}": name for name in cameras} | {FRAMES[n]: n for n in FRAMES if n in rig.sensors}
        for frame, name in placed.items():
            pose = BASE_FROM_RIG @ rig.rig_from(name)
            transform = made("geometry_msgs/msg/Transform", vector(pose.translation), turn(pose))
            stamped = made("geometry_msgs/msg/TransformStamped", header(START_NS, "base_link"), frame, transform)
            transforms.append(stamped)
        if tf:
            name = "tf2_msgs/msg/TFMessage"
            put("/tf_static", name, START_NS, made(name, transforms))
        for camera in cameras:
            lens = rig.camera(camera)
            k = lens.matrix.ravel()
            shift = 0.0 if camera != "right" else -lens.fx * rig.baseline_m
            p = np.array([lens.fx, 0, lens.cx, shift, 0, lens.fy, lens.cy, 0, 0, 0, 1, 0], float)
            region = made("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
            d = np.array([*lens.distortion, 0, 0, 0, 0, 0][:5], float)
            size, matrices = (lens.height, lens.width), (k, np.eye(3).ravel(), p)
            of = header(START_NS, f"{camera}_{optical}")
            message = made("sensor_msgs/msg/CameraInfo", of, *size, "plumb_bob", d, *matrices, 0, 0, region)
            if info:
                put(f"/{camera}/camera_info", "sensor_msgs/msg/CameraInfo", START_NS, message)
        odometry = Pose()
        begun = False
        for i in range(len(sequence)):
            measured = sequence[i]
            time_ns = START_NS + measured.time_ns
            for camera, image in images_of(measured).items():
                if camera in cameras:
                    encoding = "mono8" if image.ndim == 2 else "rgb8"
                    wide = image.shape[1] * (1 if image.ndim == 2 else 3)
                    of = header(time_ns, f"{camera}_{optical}")
                    values = (*image.shape[:2], encoding, 0, wide, np.ascontiguousarray(image).ravel())
                    name = "sensor_msgs/msg/Image"
                    put(f"/{camera}/image_raw", name, time_ns, made(name, of, *values))
            if isinstance(measured, ImuSamples):
                unknown = np.zeros(9)
                samples = zip(
                    measured.times_ns.tolist(),
                    measured.angular_velocity_rad_s,
                    measured.specific_force_m_s2,
                    strict=True,
                )
                for t, rate, force in samples:
                    of, none = (
                        header(START_NS + t, FRAMES["imu"]),
                        made("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0),
                    )
                    values = (none, unknown, vector(rate), unknown, vector(force), unknown)
                    put(named["imu"], "sensor_msgs/msg/Imu", START_NS + t, made("sensor_msgs/msg/Imu", of, *values))
            if isinstance(measured, GnssFix):
                of, status = header(time_ns, FRAMES["gnss"]), made("sensor_msgs/msg/NavSatStatus", 0, 1)
                place = geodetic(measured.xyz_in_local)
                covariance = np.ascontiguousarray(measured.covariance).ravel()
                message = made("sensor_msgs/msg/NavSatFix", of, status, *place, covariance, 2)
                put(named["gnss"], "sensor_msgs/msg/NavSatFix", time_ns, message)
            if isinstance(measured, WheelIncrement):
                if not begun:
                    begun = True
                    _put_odometry(put, made, header, named["wheel"], START_NS + measured.since_ns, odometry, turn)
                odometry = odometry @ arc(measured)
                _put_odometry(put, made, header, named["wheel"], time_ns, odometry, turn)
        if extra:
            of = header(START_NS, "laser_link")
            empty = np.zeros(0, np.float32)
            scan = made("sensor_msgs/msg/LaserScan", of, *([0.0] * 7), empty, empty)
            put("/scan", "sensor_msgs/msg/LaserScan", START_NS, scan)
            put("/warm", "sensor_msgs/msg/Temperature", START_NS, made("sensor_msgs/msg/Temperature", of, 20.0, 0.0))
    return path


def _put_odometry(put: Any, made: Any, header: Any, topic: str, time_ns: int, pose: Pose, turn: Any) -> None:
    point = made("geometry_msgs/msg/Point", *map(float, pose.translation))
    still = made("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
    of, name = header(time_ns, "odom"), "nav_msgs/msg/Odometry"
    where = made(
        "geometry_msgs/msg/PoseWithCovariance", made("geometry_msgs/msg/Pose", point, turn(pose)), np.zeros(36)
    )
    twist = made("geometry_msgs/msg/TwistWithCovariance", made("geometry_msgs/msg/Twist", still, still), np.zeros(36))
    put(topic, name, time_ns, made(name, of, FRAMES["wheel"], where, twist))


def geodetic(xyz_in_local: Array) -> list[float]:
    """Latitude, longitude [deg] and height [m]."""
    pymap3d = pytest.importorskip("pymap3d", reason="the extra `fusion` is not installed")
    east, north, up = xyz_in_local
    return [float(v) for v in pymap3d.enu2geodetic(east, north, up, *ORIGIN)]


def arc(measured: WheelIncrement) -> Pose:
    """The motion in the plane of an increment: an arc of its length."""
    angle = measured.turned_rad or 0.0
    chord = measured.distance_m * np.sinc(angle / (2 * np.pi))
    place = chord * np.array([np.cos(angle / 2), np.sin(angle / 2), 0.0])
    return Pose.from_rotvec(np.array([0.0, 0.0, angle]), place)


def write_tables(folder: Path, sequence: Sequence, opened: Sequence, camera: str = "left", names: Any = FRAMES) -> Path:
    """Writes the same measurements as tables, and the file for `--sensors` that names them, for a recording that was
    opened. The odometry has an exact time only with its own increments."""
    rows: dict[str, list[str]] = {
        "imu": ["time_ns gx gy gz ax ay az"],
        "gnss": ["time_ns lat lon height sigma_x sigma_y sigma_z"],
        "wheel": ["time_ns distance turn"],
    }
    for measured in (sequence[i] for i in range(len(sequence))):
        _add_rows(rows, measured)
    opened_from = (
        opened.rig.rig_from("left" if opened.rig.has_stereo else "video") @ sequence.rig.rig_from(camera).inverse()
    )
    lines = []
    for name in names:
        if name in sequence.rig.sensors:
            (folder / f"{name}.csv").write_text("\n".join(rows[name]) + "\n")
            pose = opened_from @ sequence.rig.rig_from(name)
            entry = f"{{translation_m: {pose.translation.tolist()}, rotation_xyzw: {pose.xyzw.tolist()}}}"
            lines.append(f"{name}: {{file: {name}.csv, rig_from_{name}: {entry}}}")
    (folder / "sensors.yaml").write_text("\n".join(lines) + "\n")
    return folder / "sensors.yaml"


def _add_rows(rows: dict[str, list[str]], measured: Measurement) -> None:
    if isinstance(measured, ImuSamples):
        values = np.hstack([measured.angular_velocity_rad_s, measured.specific_force_m_s2])
        for t, row in zip(measured.times_ns.tolist(), values.tolist(), strict=True):
            rows["imu"].append(" ".join([str(START_NS + t), *map(repr, row)]))
    if isinstance(measured, GnssFix):
        place = geodetic(measured.xyz_in_local)
        sigma = np.sqrt(np.diag(measured.covariance)).tolist()
        rows["gnss"].append(" ".join([str(START_NS + measured.time_ns), *map(repr, (*place, *sigma))]))
    if isinstance(measured, WheelIncrement):
        if len(rows["wheel"]) == 1:
            rows["wheel"].append(f"{START_NS + measured.since_ns} 0 0")
        rows["wheel"].append(
            f"{START_NS + measured.time_ns} {float(measured.distance_m)!r} {float(measured.turned_rad or 0)!r}"
        )
