"""Bags that rosbags itself wrote: one camera and pairs, raw and compressed, whole and damaged."""

from __future__ import annotations

import struct
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.types import StereoPair, VideoFrame
from tests.sequences.bag_folders import DELAY_NS, START_NS, STEP_NS, make_bag
from tests.sequences.folders import images

KINDS = ("ros1", "sqlite3", "mcap")


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


def test_a_topic_whose_name_is_a_number_is_one_sentence(tmp_path: Path) -> None:
    bag = make_bag(tmp_path, "mcap", ("cam0", "cam1"))
    text = (bag / "metadata.yaml").read_text()
    (bag / "metadata.yaml").write_text(text.replace("/cam0/image_raw", "0x1F"))
    with pytest.raises(InputError, match="is not a whole bag"):
        open_sequence(str(bag))


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_a_binned_camera_info_is_that_of_the_whole_sensor(kind: str, compressed: bool, tmp_path: Path) -> None:
    """As ROS defines it: K and P are divided by the binning, of one camera and of a pair."""
    path = make_bag(tmp_path / "one", kind, ("camera",), compressed, binning=2)
    sequence = open_sequence(str(path))
    assert sequence.rig.camera("video").fx == 80 and sequence.rig.camera("video").cx == 47.5
    assert isinstance(sequence[0], VideoFrame) and any("binning 2 x 2" in note for note in sequence.notes)
    pair = open_sequence(str(make_bag(tmp_path / "two", kind, ("left", "right"), compressed, binning=2)))
    assert pair.rig.baseline_m == pytest.approx(0.5) and pair.rig.camera("left").fx == 80
    assert isinstance(pair[0], StereoPair)


@pytest.mark.parametrize("compressed", [False, True])
def test_images_of_another_size_than_their_camera_info_are_refused_when_the_bag_is_opened(
    compressed: bool, tmp_path: Path
) -> None:
    """So that `sources` says what `run` does."""
    path = make_bag(tmp_path, "ros1", ("camera",), compressed, binning=2)
    raw = path.read_bytes()
    path.write_bytes(raw.replace(struct.pack("<II", 2, 2), struct.pack("<II", 0, 0)))
    with pytest.raises(InputError, match="are 96 x 64, not 192 x 128 as their camera_info says"):
        open_sequence(str(path))


def test_a_pair_that_is_exchanged_is_mentioned(tmp_path: Path) -> None:
    sequence = open_sequence(str(make_bag(tmp_path, "ros1", ("left", "right"), baseline_m=-0.5)))
    assert not sequence.rig.has_stereo and any("the cameras are exchanged" in note for note in sequence.notes)


def test_a_pair_without_a_baseline_is_mentioned(tmp_path: Path) -> None:
    sequence = open_sequence(str(make_bag(tmp_path, "ros1", ("left", "right"), baseline_m=0)))
    assert not sequence.rig.has_stereo and any("without a baseline" in note for note in sequence.notes)


def test_a_baseline_in_millimetres_is_mentioned(tmp_path: Path) -> None:
    sequence = open_sequence(str(make_bag(tmp_path, "ros1", ("left", "right"), baseline_m=500.0)))
    assert any("likely in millimetres" in note for note in sequence.notes)


def test_fisheye_lenses_and_fourteen_coefficients(tmp_path: Path) -> None:
    model = ("equidistant", (0.01, -0.002, 0.001, 0.0))
    camera = open_sequence(str(make_bag(tmp_path / "a", "mcap", ("camera",), model=model))).rig.camera("video")
    assert camera.lens == "fisheye" and camera.distortion == model[1]
    assert open_sequence(str(make_bag(tmp_path / "b", "mcap", ("left", "right"), model=model))).rig.has_stereo
    model = ("rational_polynomial", (0.3, -0.2, 0.0, 0.0, 0.01, 0.6, -0.1, 0.02, *(0.0,) * 6))
    camera = open_sequence(str(make_bag(tmp_path / "c", "ros1", ("camera",), model=model))).rig.camera("video")
    assert camera.distortion == model[1][:8]
    with pytest.raises(InputError, match="distortion_model is omni"):
        open_sequence(str(make_bag(tmp_path / "d", "ros1", ("camera",), model=("omni", (0.1,) * 4))))
