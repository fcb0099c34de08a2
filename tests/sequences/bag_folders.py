"""Tiny bags, written by rosbags itself; a test that asks for one is skipped where that is not installed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

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
    baseline_m: float = 0.5,
    binning: int = 0,
    model: tuple[str, tuple[float, ...]] = ("plumb_bob", (0.0,) * 5),
    names: tuple[str, str] = ("/{}/image_raw", "/{}/camera_info"),
    calibrated: tuple[str, ...] | None = None,
) -> Path:
    """Six images per camera, exposed DELAY_NS before they were written, and a camera_info (baseline_m between cameras,
    a sensor `binning` times as large as the images, and the distortion model and coefficients).

    `names` are those of the topics of images and of camera_info, where {} stands for the camera; only those
    `calibrated` have one. `info` may also be "zeros", as that of a camera without calibration. `stamp` gives the time
    [ns] in an image's header; compressed images are PNG files of the encoded values.
    """
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

    def header(time_ns: int) -> Any:
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
            for i, image in enumerate(images(6, 8 * max(1 - k, 0))):
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
            put(f"{names[0].format(camera)}{'/compressed' if compressed else ''}", name, written, found)
            if not info or camera not in (cameras if calibrated is None else calibrated):
                continue
            n = max(binning, 1)
            k_matrix = np.array([80.0 * n, 0, 47.5 * n, 0, 80 * n, 31.5 * n, 0, 0, 1])
            shift = -80.0 * n * baseline_m * k
            p_matrix = np.array([80.0 * n, 0, 47.5 * n, shift, 0, 80 * n, 31.5 * n, 0, 0, 0, 1, 0])
            matrices = (k_matrix, np.eye(3).ravel(), p_matrix)
            region = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
            size = (HEIGHT * n, WIDTH * n)
            if info == "zeros":
                size, model, matrices = (0, 0), ("", ()), tuple(np.zeros(count) for count in (9, 9, 12))
            camera_message = types["sensor_msgs/msg/CameraInfo"](
                header(START_NS), *size, model[0], np.array(model[1]), *matrices, binning, binning, region
            )
            put(names[1].format(camera), "sensor_msgs/msg/CameraInfo", [START_NS], [camera_message])
    return path


BAGS: dict[str, Callable[[Path], Path]] = {
    "bag of ROS 1, one camera": lambda root: make_bag(root, "ros1", ("camera",)),
    "bag of ROS 2, compressed pair": lambda root: make_bag(root, "sqlite3", ("left", "right"), compressed=True),
    "mcap, pair": lambda root: make_bag(root, "mcap", ("cam0", "cam1")),
}
"""Each writes a recording of six exposures below a folder and gives its path."""
