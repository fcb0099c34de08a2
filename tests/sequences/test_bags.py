"""Bags that rosbags itself wrote: one camera and pairs, raw and compressed, whole and damaged."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.types import StereoPair, VideoFrame
from tests.sequences.folders import HEIGHT, WIDTH, images

rosbags = pytest.importorskip("rosbags", reason="the extra `bags` is not installed")
from rosbags.rosbag1 import Writer as Writer1  # noqa: E402
from rosbags.rosbag2 import StoragePlugin  # noqa: E402
from rosbags.rosbag2 import Writer as Writer2  # noqa: E402
from rosbags.typesys import Stores, get_typestore  # noqa: E402

KINDS = ("ros1", "sqlite3", "mcap")
START_NS, STEP_NS, DELAY_NS = 1_700_000_000_000_000_000, 50_000_000, 7_000_000


def make_bag(root: Path, kind: str, cameras: tuple[str, ...], compressed: bool = False, info: bool = True) -> Path:
    """Six images per camera, exposed DELAY_NS before they were written, and a camera_info (0.5 m between cameras)."""
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
            for time_ns, image in zip(written, images(6, 8 * (1 - k)), strict=True):
                if compressed:
                    data = cv2.imencode(".png", image)[1]
                    found.append(types["sensor_msgs/msg/CompressedImage"](header(time_ns - DELAY_NS), "png", data))
                else:
                    found.append(
                        types["sensor_msgs/msg/Image"](
                            header(time_ns - DELAY_NS), HEIGHT, WIDTH, "mono8", 0, WIDTH, image.reshape(-1)
                        )
                    )
            name = f"sensor_msgs/msg/{'CompressedImage' if compressed else 'Image'}"
            put(f"/{camera}/image_raw{'/compressed' if compressed else ''}", name, written, found)
            if not info:
                continue
            k_matrix = np.array([80.0, 0, 47.5, 0, 80, 31.5, 0, 0, 1])
            p_matrix = np.array([80.0, 0, 47.5, -40.0 * k, 0, 80, 31.5, 0, 0, 0, 1, 0])
            matrices = (k_matrix, np.eye(3).ravel(), p_matrix)
            region = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
            told = types["sensor_msgs/msg/CameraInfo"](
                header(START_NS), HEIGHT, WIDTH, "plumb_bob", np.zeros(5), *matrices, 0, 0, region
            )
            put(f"/{camera}/camera_info", "sensor_msgs/msg/CameraInfo", [START_NS], [told])
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_one_camera(kind: str, tmp_path: Path) -> None:
    sequence = open_sequence(str(make_bag(tmp_path, kind, ("camera",))))
    assert sequence.kinds == ("video",) * 6 and sequence.rig.camera("video").fx == 80
    assert sequence.times_ns.tolist() == [START_NS - DELAY_NS + i * STEP_NS for i in range(6)]
    for i, image in reversed(list(enumerate(images(6, 8)))):
        exposure = sequence[i]
        assert isinstance(exposure, VideoFrame) and not exposure.image.flags.writeable
        np.testing.assert_array_equal(exposure.image, image)


@pytest.mark.parametrize("kind", KINDS)
def test_a_compressed_pair(kind: str, tmp_path: Path) -> None:
    path = make_bag(tmp_path, kind, ("stereo/left", "stereo/right"), compressed=True)
    sequence = open_sequence(str(path), stereo_every=2)
    assert sequence.rig.baseline_m == pytest.approx(0.5) and sequence.kinds.count("stereo") == 3
    pair = sequence[0]
    assert isinstance(pair, StereoPair)
    np.testing.assert_array_equal(pair.left, images(6, 8)[0])
    np.testing.assert_array_equal(pair.right, images(6, 0)[0])


@pytest.mark.parametrize("kind", KINDS)
def test_several_threads_may_read(kind: str, tmp_path: Path) -> None:
    sequence = open_sequence(str(make_bag(tmp_path, kind, ("camera",))))
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(sequence.load, list(range(6)) * 4))
    assert [e.time_ns for e in found] == sequence.times_ns.tolist() * 4


def test_a_file_of_a_ros_2_bag_alone(tmp_path: Path) -> None:
    folder = make_bag(tmp_path, "mcap", ("camera",))
    assert len(open_sequence(str(next(folder.glob("*.mcap"))))) == 6


def test_without_camera_info_a_camera_file_is_asked_for(tmp_path: Path) -> None:
    path = make_bag(tmp_path, "ros1", ("cam0", "cam1"), info=False)
    with pytest.raises(InputError, match=r"no camera_info for /cam0/image_raw: write .*camera\.yaml"):
        open_sequence(str(path))
    (tmp_path / "camera.yaml").write_text("{width: 96, height: 64, fx: 80, fy: 80, cx: 47.5, cy: 31.5}")
    sequence = open_sequence(str(path))
    assert len(sequence) == 6 and "not /cam1/image_raw" in sequence.notes[0]


def test_without_the_extra_its_name_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "drive.bag").touch()
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(InputError, match=r"pip install 'ispom\[bags\]'"):
        open_sequence(str(tmp_path / "drive.bag"))


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_bag_is_an_input_error(kind: str, tmp_path: Path) -> None:
    path = make_bag(tmp_path, kind, ("camera",))
    file = path if kind == "ros1" else next(p for p in path.iterdir() if p.suffix != ".yaml")
    whole, generator = file.read_bytes(), np.random.default_rng(5)
    for _ in range(12):
        content = bytearray(whole)
        content[int(generator.integers(len(whole)))] ^= 0xFF
        for spoiled in (bytes(content), whole[: int(generator.integers(len(whole)))]):
            file.write_bytes(spoiled)
            try:
                sequence = open_sequence(str(path))
                sequence[0]
            except InputError as error:
                assert str(tmp_path) in str(error) and "\n" not in str(error)
