"""Tiny bags, written by rosbags itself; a test that asks for one is skipped where that is not installed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.sequences.folders import HEIGHT, WIDTH, images

START_NS, STEP_NS, DELAY_NS = 1_700_000_000_000_000_000, 50_000_000, 7_000_000


Encode = Callable[[np.ndarray], tuple[str, np.ndarray]]
"""An image's encoding, and its values (H, W) or (H, W, C)."""


def make_bag(
    root: Path,
    kind: str,
    cameras: tuple[str, ...],
    compressed: bool = False,
    info: bool | str = True,
    encode: Encode = lambda image: ("mono8", image),
    stamp: Callable[[int], int] = lambda i: START_NS - DELAY_NS + i * STEP_NS,
) -> Path:
    """Six images per camera, exposed DELAY_NS before they were written, and a camera_info (0.5 m between cameras).

    `info` may also be "zeros", as that of a camera without calibration, or another distortion model.

    `stamp` gives the time [ns] in an image's header; compressed images are PNG files of the encoded values."""
    pytest.importorskip("rosbags", reason="the extra `bags` is not installed")
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
    types, upper = store.types, kind == "ros1"
    root.mkdir(parents=True, exist_ok=True)
    path = root / ("drive.bag" if upper else "drive")
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    writer = Writer1(path) if upper else Writer2(path, version=9, storage_plugin=plugin)

    def header(time_ns: int) -> object:
        stamp = types["builtin_interfaces/msg/Time"](*divmod(time_ns, 10**9))
        counter = {"seq": 0} if upper else {}
        return types["std_msgs/msg/Header"](**counter, stamp=stamp, frame_id="camera")

    def put(topic: str, name: str, written_ns: list[int], messages: list) -> None:
        connection = writer.add_connection(topic, name, typestore=store)
        for time_ns, message in zip(written_ns, messages, strict=True):
            raw = store.serialize_ros1(message, name) if upper else store.serialize_cdr(message, name)
            writer.write(connection, time_ns, bytes(raw))

    written = [START_NS + i * STEP_NS for i in range(6)]
    with writer:
        for k, camera in enumerate(cameras):
            found = []
            for i, image in enumerate(images(6, 8 * (1 - k))):
                encoding, values = encode(image)
                if compressed:
                    data = cv2.imencode(".png", values)[1]
                    found.append(types["sensor_msgs/msg/CompressedImage"](header(stamp(i)), "png", data))
                else:
                    big, data = int(values.dtype.byteorder == ">"), np.frombuffer(values.tobytes(), np.uint8)
                    height, width = values.shape[:2]
                    what = header(stamp(i)), height, width, encoding, big, len(data) // height, data
                    found.append(types["sensor_msgs/msg/Image"](*what))
            name = f"sensor_msgs/msg/{'CompressedImage' if compressed else 'Image'}"
            put(f"/{camera}/image_raw{'/compressed' if compressed else ''}", name, written, found)
            if not info:
                continue
            k_matrix = np.array([80.0, 0, 47.5, 0, 80, 31.5, 0, 0, 1])
            p_matrix = np.array([80.0, 0, 47.5, -40.0 * k, 0, 80, 31.5, 0, 0, 0, 1, 0])
            matrices = (k_matrix, np.eye(3).ravel(), p_matrix)
            region = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
            size, model, distortion = (HEIGHT, WIDTH), info if isinstance(info, str) else "plumb_bob", np.zeros(5)
            if info == "zeros":
                size, model, matrices = (0, 0), "", tuple(np.zeros(n) for n in (9, 9, 12))
            if info == "equidistant":
                distortion = np.array([0.01, 0, 0, 0])
            told = types["sensor_msgs/msg/CameraInfo"](
                header(START_NS), *size, model, distortion, *matrices, 0, 0, region
            )
            put(f"/{camera}/camera_info", "sensor_msgs/msg/CameraInfo", [START_NS], [told])
    return path


BAGS: dict[str, Callable[[Path], Path]] = {
    "bag of ROS 1, one camera": lambda root: make_bag(root, "ros1", ("camera",)),
    "bag of ROS 2, compressed pair": lambda root: make_bag(root, "sqlite3", ("left", "right"), compressed=True),
    "mcap, pair": lambda root: make_bag(root, "mcap", ("cam0", "cam1")),
}
"""Each writes a recording of six exposures below a folder and gives its path."""
