"""Writes the result of a method as an MCAP file with messages of ROS 2, for Foxglove and ROS, through `rosbags`.

| topic | type | contents |
| --- | --- | --- |
| /pose | geometry_msgs/PoseStamped | world_from_camera at each time |
| /path | nav_msgs/Path | all poses, at the end |
| /tf | tf2_msgs/TFMessage | the same, of the frame `camera` in the frame `world` |
| /points | sensor_msgs/PointCloud2 | the landmarks, with colours |
| /camera/image/compressed | sensor_msgs/CompressedImage | JPEG images |
| /camera/camera_info | sensor_msgs/CameraInfo | their lens |
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np

from ispom.cameras import require_opencv
from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.types import Camera, Image, Landmarks, Trajectory

WORLD, CAMERA = "world", "camera"
JPEG_QUALITY = 90
"""Quality of the compressed images, of OpenCV's range from 0 to 100."""
POINT_FIELD_FLOAT32 = 7
"""Number of the type float32 in sensor_msgs/PointField."""
_MODELS = {"fisheye": ("equidistant", 4)}
Dated = tuple[int, str, str, Any]
"""Time [ns], topic and type of a message, and the message."""


def mcap_bytes(
    camera: Camera, poses: Trajectory, landmarks: Landmarks, images: Iterable[tuple[int, Image]] = ()
) -> bytes:
    """Returns the file; `poses` are world_from_camera, `images` have times [ns]. Raises InputError without rosbags, and
    for a lens that ROS does not have."""
    if find_spec("rosbags") is None:
        raise InputError("a file of MCAP takes the extra `bags` to write: pip install 'ispom[bags]'")
    require_opencv(camera, "ROS")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    messages = [*_poses(store.types, poses), *_images(store.types, camera, images)]
    if len(poses):
        messages.append(_points(store.types, landmarks, int(poses.times_ns[-1])))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "run"
        with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            connections: dict[str, Any] = {}
            for time_ns, topic, kind, message in sorted(messages, key=lambda each: each[0]):
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                writer.write(connections[topic], time_ns, bytes(store.serialize_cdr(message, kind)))
        return (path / "run.mcap").read_bytes()


def _header(types: Any, time_ns: int, frame: str) -> Any:
    stamp = types["builtin_interfaces/msg/Time"](*divmod(time_ns, 10**9))
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def _poses(types: Any, poses: Trajectory) -> list[Dated]:
    found: list[Dated] = []
    stamped = []
    for time_ns, pose in poses.items():
        header = _header(types, time_ns, WORLD)
        turn = types["geometry_msgs/msg/Quaternion"](*_xyzw(pose))
        place = types["geometry_msgs/msg/Point"](*pose.translation.tolist())
        moved = types["geometry_msgs/msg/Vector3"](*pose.translation.tolist())
        stamped.append(types["geometry_msgs/msg/PoseStamped"](header, types["geometry_msgs/msg/Pose"](place, turn)))
        transform = types["geometry_msgs/msg/TransformStamped"](
            header, CAMERA, types["geometry_msgs/msg/Transform"](moved, turn)
        )
        found.append((time_ns, "/pose", "geometry_msgs/msg/PoseStamped", stamped[-1]))
        found.append((time_ns, "/tf", "tf2_msgs/msg/TFMessage", types["tf2_msgs/msg/TFMessage"]([transform])))
    if stamped:
        last = int(poses.times_ns[-1])
        path = types["nav_msgs/msg/Path"](_header(types, last, WORLD), stamped)
        found.append((last, "/path", "nav_msgs/msg/Path", path))
    return found


def _xyzw(pose: Pose) -> list[float]:
    w, x, y, z = pose.wxyz.tolist()
    return [x, y, z, w]


def _points(types: Any, landmarks: Landmarks, time_ns: int) -> Dated:
    kind = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")])
    values = np.zeros(len(landmarks), kind)
    values["x"], values["y"], values["z"] = landmarks.xyz_in_world.T.astype(np.float32)
    red, green, blue = landmarks.rgb.T.astype(np.uint32)
    values["rgb"] = red << 16 | green << 8 | blue
    fields = [
        types["sensor_msgs/msg/PointField"](name, 4 * n, POINT_FIELD_FLOAT32, 1)
        for n, name in enumerate(kind.names or ())
    ]
    data, count = np.frombuffer(values.tobytes(), np.uint8), len(values)
    cloud = types["sensor_msgs/msg/PointCloud2"](
        _header(types, time_ns, WORLD), 1, count, fields, False, kind.itemsize, kind.itemsize * count, data, True
    )
    return time_ns, "/points", "sensor_msgs/msg/PointCloud2", cloud


def _images(types: Any, camera: Camera, images: Iterable[tuple[int, Image]]) -> list[Dated]:
    found: list[Dated] = []
    for time_ns, image in images:
        bgr = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
        header = _header(types, time_ns, CAMERA)
        message = types["sensor_msgs/msg/CompressedImage"](header, "jpeg", data.ravel())
        found.append((time_ns, "/camera/image/compressed", "sensor_msgs/msg/CompressedImage", message))
        info = _info(types, camera, header)
        found.append((time_ns, "/camera/camera_info", "sensor_msgs/msg/CameraInfo", info))
    return found


def _info(types: Any, camera: Camera, header: Any) -> Any:
    few = ("plumb_bob", 5) if len(camera.distortion) <= 5 else ("rational_polynomial", 8)
    model, count = _MODELS.get(camera.lens, few)
    coefficients = np.array((*camera.distortion, *(0.0,) * 8)[:count])
    matrix = np.asarray(camera.matrix, float)
    projection = np.column_stack([matrix, np.zeros(3)])
    region = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    return types["sensor_msgs/msg/CameraInfo"](
        header, camera.height, camera.width, model, coefficients, matrix.ravel(), np.eye(3).ravel(),
        projection.ravel(), 0, 0, region,
    )  # fmt: skip
