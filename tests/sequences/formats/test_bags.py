"""Bags that rosbags itself wrote: one camera and pairs, raw and compressed, whole and damaged."""

from __future__ import annotations

import struct
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.rig import rig_text
from ispom.sequences import open_sequence
from ispom.types import Camera, Rig, is_stereo, is_video
from tests.sequences.bag_folders import DELAY_NS, START_NS, STEP_NS, make_bag
from tests.sequences.folders import HEIGHT, WIDTH, images

KINDS = ("ros1", "sqlite3", "mcap")


@pytest.mark.parametrize("kind", KINDS)
def test_one_camera(kind: str, tmp_path: Path) -> None:
    sequence = open_sequence(str(make_bag(tmp_path, kind, ("camera",))))
    assert sequence.kinds == ("video",) * 6 and sequence.rig.camera("video").fx == 80
    assert sequence.times_ns.tolist() == [START_NS - DELAY_NS + i * STEP_NS for i in range(6)]
    for i, image in reversed(list(enumerate(images(6, 8)))):
        exposure = sequence[i]
        assert is_video(exposure) and not exposure.image.flags.writeable
        np.testing.assert_array_equal(exposure.image, image)


@pytest.mark.parametrize("kind", KINDS)
def test_a_compressed_pair(kind: str, tmp_path: Path) -> None:
    path = make_bag(tmp_path, kind, ("stereo/left", "stereo/right"), compressed=True)
    sequence = open_sequence(str(path), stereo_every=2)
    assert sequence.rig.baseline_m == pytest.approx(0.5) and sequence.kinds.count("stereo") == 3
    pair = sequence[0]
    assert is_stereo(pair)
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


@pytest.mark.parametrize("info", [False, "zeros"])
def test_a_camera_without_calibration_is_a_guess_or_that_of_a_file(info: bool | str, tmp_path: Path) -> None:
    path = make_bag(tmp_path, "ros1", ("cam0", "cam1"), info=info)
    sequence = open_sequence(str(path))
    camera = sequence.rig.camera("video")
    assert (camera.width, camera.height, camera.fx) == (96, 64, 0.7 * 96) and sequence.guess is not None
    assert any("/cam0/image_raw" in note and "--camera" in note for note in sequence.notes)
    for beside in (False, True):
        file = tmp_path / ("camera.yaml" if beside else "own.yaml")
        file.write_text("{width: 96, height: 64, fx: 80, fy: 80, cx: 47.5, cy: 31.5}")
        sequence = open_sequence(str(path), camera=None if beside else file)
        assert len(sequence) == 6 and "not /cam1/image_raw" in sequence.notes[0] and sequence.guess is None
        assert sequence.rig.camera("video").fx == 80
        sequence[0]


def test_a_calibration_takes_the_place_of_none_that_is_good(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text("{width: 96, height: 64, fx: 90, fy: 90, cx: 47.5, cy: 31.5}")
    odd = make_bag(tmp_path / "odd", "ros1", ("camera",), model=("double_sphere", (0.0,) * 5))
    with pytest.raises(InputError, match=r"double_sphere.*--camera"):
        open_sequence(str(odd))
    assert open_sequence(str(odd), camera=tmp_path / "own.yaml").rig.camera("video").fx == 90
    for cameras in (("camera",), ("left", "right")):
        whole = make_bag(tmp_path / cameras[0], "ros1", cameras)
        with pytest.raises(InputError, match="own calibration: leave --camera"):
            open_sequence(str(whole), camera=tmp_path / "own.yaml")


def test_a_fisheye_is_read_as_in_files_of_ros(tmp_path: Path) -> None:
    camera = open_sequence(
        str(make_bag(tmp_path, "ros1", ("camera",), model=("equidistant", (0.01, 0, 0, 0))))
    ).rig.camera("video")
    assert camera.lens == "fisheye" and camera.distortion == (0.01, 0, 0, 0)


def grey(image: np.ndarray) -> np.ndarray:
    return np.dstack([image] * 3)


def uyvy(image: np.ndarray, luma: int) -> np.ndarray:
    found = np.full((*image.shape, 2), 128, np.uint8)
    found[..., luma] = (16 + image * (219 / 255)).round()
    return found


ENCODED: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "mono8": lambda image: image,
    "8UC1": lambda image: image,
    "rgb8": grey,
    "bgr8": grey,
    "rgba8": lambda image: np.dstack([grey(image), image * 0]),
    "bgra8": lambda image: np.dstack([grey(image), image * 0]),
    "mono16": lambda image: image.astype("<u2") * 257,
    "16UC1": lambda image: image.astype("<u2") * 16,
    "mono16 ": lambda image: image.astype(">u2") * 4,
    "16SC1": lambda image: image.astype("<i2") * 64,
    "rgb16": lambda image: grey(image).astype("<u2") * 257,
    "bgra16": lambda image: np.dstack([grey(image), image]).astype("<u2") * 257,
    "32FC1": lambda image: image.astype("<f4") / 255,
    "yuv422": lambda image: uyvy(image, 1),
    "uyvy": lambda image: uyvy(image, 1),
    "yuv422_yuy2": lambda image: uyvy(image, 0),
    "yuyv": lambda image: uyvy(image, 0),
}
"""Of an image in grey, also with 10, 12 and 14 bits; with a space behind its name: in the other order of bytes."""


@pytest.mark.parametrize("encoding", ENCODED)
def test_every_encoding_gives_the_same_image(encoding: str, tmp_path: Path) -> None:
    path = make_bag(tmp_path, "ros1", ("camera",), encode=lambda image: (encoding.strip(), ENCODED[encoding](image)))
    sequence = open_sequence(str(path))
    for i, image in enumerate(images(6, 8)):
        exposure = sequence[i]
        assert is_video(exposure) and exposure.image.dtype == np.uint8
        seen = exposure.image if exposure.image.ndim == 2 else exposure.image.mean(axis=2)
        # Values are scaled by their range: of an image whose largest value is not that of its kind, a little off.
        np.testing.assert_allclose(seen, image, atol=2)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize(("pattern", "red"), [("rggb", (0, 0)), ("bggr", (1, 1)), ("gbrg", (1, 0)), ("grbg", (0, 1))])
def test_red_is_red_whatever_the_pattern(pattern: str, red: tuple[int, int], bits: int, tmp_path: Path) -> None:
    def mosaic(image: np.ndarray) -> tuple[str, np.ndarray]:
        found = np.zeros(image.shape, np.uint8 if bits == 8 else "<u2")
        found[red[0] :: 2, red[1] :: 2] = 2**bits - 1
        return f"bayer_{pattern}{bits}", found

    exposure = open_sequence(str(make_bag(tmp_path, "ros1", ("camera",), encode=mosaic)))[0]
    assert is_video(exposure)
    np.testing.assert_array_equal(exposure.image[8:-8, 8:-8].reshape(-1, 3).mean(axis=0).round(), [255, 0, 0])


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_compressed_images_of_more_than_8_bits_have_the_range_of_all(bits: int, tmp_path: Path) -> None:
    def wide(image: np.ndarray) -> tuple[str, np.ndarray]:
        return "mono16", np.rint(image * ((2**bits - 1) / 255)).astype(np.uint16)

    sequence = open_sequence(str(make_bag(tmp_path, "ros1", ("camera",), compressed=True, encode=wide)))
    for i, image in enumerate(images(6, 8)):
        exposure = sequence[i]
        assert is_video(exposure)
        np.testing.assert_allclose(exposure.image, image, atol=1)


@pytest.mark.parametrize("encoding", ["nv24", "jpeg", ""])
def test_an_encoding_that_is_not_known_is_refused_at_once(encoding: str, tmp_path: Path) -> None:
    path = make_bag(tmp_path, "ros1", ("camera",), encode=lambda image: (encoding, image))
    with pytest.raises(InputError, match=f"{encoding}.*mono8"):
        open_sequence(str(path))


@pytest.mark.parametrize("kind", KINDS)
def test_images_whose_stamps_repeat_have_the_times_of_the_bag(kind: str, tmp_path: Path) -> None:
    path = make_bag(tmp_path, kind, ("camera",), stamp=lambda i: START_NS + i // 2 * 2 * STEP_NS)
    sequence = open_sequence(str(path))
    assert sequence.times_ns.tolist() == [START_NS + i * STEP_NS for i in range(6)]
    assert "3 of 6 images of /camera/image_raw" in sequence.notes[0]
    for i, image in enumerate(images(6, 8)):
        exposure = sequence[i]
        assert is_video(exposure)
        np.testing.assert_array_equal(exposure.image, image)


def test_a_pair_whose_stamps_repeat_is_by_one_clock(tmp_path: Path) -> None:
    path = make_bag(tmp_path, "ros1", ("left", "right"), stamp=lambda i: START_NS + i // 2 * 2 * STEP_NS)
    sequence = open_sequence(str(path))
    assert sequence.kinds.count("stereo") == 6 and sum("repeat the time" in note for note in sequence.notes) == 2


def test_an_image_that_was_recorded_twice_is_left_out_and_noted(tmp_path: Path) -> None:
    first = images(6, 8)[0]
    path = make_bag(
        tmp_path,
        "ros1",
        ("camera",),
        encode=lambda image: ("mono8", first),
        stamp=lambda i: START_NS + i // 2 * STEP_NS,
    )
    sequence = open_sequence(str(path))
    assert sequence.times_ns.tolist() == [START_NS + i * STEP_NS for i in range(3)]
    assert "3 of 6 images of /camera/image_raw" in sequence.notes[0]


def test_without_the_extra_its_name_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
    with pytest.raises(InputError, match="whole bag"):
        open_sequence(str(bag))


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_a_binned_camera_info_is_that_of_the_whole_sensor(kind: str, compressed: bool, tmp_path: Path) -> None:
    """As ROS defines it: K and P are divided by the binning, of one camera and of a pair."""
    path = make_bag(tmp_path / "one", kind, ("camera",), compressed, binning=2)
    sequence = open_sequence(str(path))
    assert sequence.rig.camera("video").fx == 80 and sequence.rig.camera("video").cx == 47.5
    assert is_video(sequence[0]) and any("binning 2 x 2" in note for note in sequence.notes)
    pair = open_sequence(str(make_bag(tmp_path / "two", kind, ("left", "right"), compressed, binning=2)))
    assert pair.rig.baseline_m == pytest.approx(0.5) and pair.rig.camera("left").fx == 80
    assert is_stereo(pair[0])


@pytest.mark.parametrize("compressed", [False, True])
def test_images_of_another_size_than_their_camera_info_are_refused_when_the_bag_is_opened(
    compressed: bool, tmp_path: Path
) -> None:
    """So that `sources` says what `run` does."""
    path = make_bag(tmp_path, "ros1", ("camera",), compressed, binning=2)
    raw = path.read_bytes()
    path.write_bytes(raw.replace(struct.pack("<II", 2, 2), struct.pack("<II", 0, 0)))
    with pytest.raises(InputError, match="96 x 64, not 192 x 128"):
        open_sequence(str(path))


def test_a_pair_that_is_exchanged_is_mentioned(tmp_path: Path) -> None:
    sequence = open_sequence(str(make_bag(tmp_path, "ros1", ("left", "right"), baseline_m=-0.5)))
    assert not sequence.rig.has_stereo and any("exchanged" in note for note in sequence.notes)


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


PLACES = (
    ("/{}/image_raw", "/{}/camera_info"),
    ("/{}/image", "/{}/image/camera_info"),
    ("/rig/image_{}", "/rig/camera_info_{}"),
    ("/rig/{}_image_rect", "/rig/{}_camera_info"),
    ("/{}/image_color", "/{}/info"),
    ("/device_0/sensor_0/{}/image/data", "/device_0/sensor_0/{}/info/camera_info"),
    ("/{}", "/{}/camera_info"),
    ("/{}", "/{}_info"),
)


@pytest.mark.parametrize("names", PLACES)
@pytest.mark.parametrize("cameras", [("left", "right"), ("l_cam", "r_cam"), ("front", "other")])
def test_a_pair_is_known_wherever_its_camera_info_is_and_whatever_it_is_called(
    names: tuple[str, str], cameras: tuple[str, str], tmp_path: Path
) -> None:
    opened = open_sequence(str(make_bag(tmp_path, "ros1", cameras, names=names)))
    assert opened.rig.has_stereo and opened.rig.baseline_m == pytest.approx(0.5)
    by_name = cameras == ("left", "right")
    assert any("by the baseline" in str(note) for note in opened.notes) != by_name
    swapped = open_sequence(str(make_bag(tmp_path / "swapped", "ros1", cameras[::-1], baseline_m=-0.5, names=names)))
    assert swapped.rig.baseline_m == pytest.approx(0.5)  # Tx says which is left


def test_one_camera_has_the_camera_info_one_level_higher_where_it_is_alone(tmp_path: Path) -> None:
    names = ("/{}/image/raw", "/{}/camera_info")
    assert open_sequence(str(make_bag(tmp_path, "ros1", ("camera",), names=names))).rig.camera("video").fx == 80
    names = ("/c/{}/image", "/c/camera_info")
    other = make_bag(tmp_path / "b", "ros1", ("color", "grey"), names=names, calibrated=("grey",))
    assert open_sequence(str(other)).guess is not None


def test_topics_are_chosen(tmp_path: Path) -> None:
    path = make_bag(tmp_path, "ros1", ("a", "b", "c"))  # each is 0.5 m to the right of the one before
    a, b, c = (f"/{name}/image_raw" for name in "abc")
    assert any("--topics" in str(note) for note in open_sequence(str(path)).notes)
    chosen = open_sequence(str(path), topics=(f"left={a}", f"right={c}"))
    assert chosen.rig.baseline_m == pytest.approx(1.0)
    chosen = open_sequence(str(path), topics=(f"right={c}", f"left={b}"))
    assert chosen.rig.baseline_m == pytest.approx(0.5)
    chosen = open_sequence(str(path), topics=(f"video={b}",))
    assert not chosen.rig.has_stereo and any(f"only {b} is used" in str(note) for note in chosen.notes)
    for words, reason in (
        ((f"left={c}", f"right={a}"), "exchanged"),
        ((f"left={a}",), "give left=TOPIC right=TOPIC"),
        ((f"left={a}", f"left={b}"), "give left=TOPIC right=TOPIC"),
        ((a, b), "give left=TOPIC right=TOPIC"),
        ((f"left={a}", f"right={a}"), "twice"),
        ((f"left={a}", "right=/nothing"), f"can name {a}"),
        ((f"video={a}", f"right={b}"), "give left=TOPIC right=TOPIC"),
    ):
        with pytest.raises(InputError, match=reason):
            open_sequence(str(path), topics=words)
    with pytest.raises(InputError, match="is no bag"):
        open_sequence("sim:tiny", topics=(f"video={a}",))
    with pytest.raises(InputError, match="is no bag"):
        open_sequence(str(path.parent), topics=(f"video={a}",))


def test_chosen_topics_without_camera_info_have_the_calibration_of_a_file(tmp_path: Path) -> None:
    path = make_bag(tmp_path, "ros1", ("a", "b", "c"), info=False)
    topics = ("left=/a/image_raw", "right=/c/image_raw")
    with pytest.raises(InputError, match="camera_info for /a/image_raw"):
        open_sequence(str(path), topics=topics)
    camera = Camera(WIDTH, HEIGHT, 80.0, 80.0, 47.5, 31.5)
    rig = Rig.of(left=camera, right=camera, rig_from_right=Pose(translation=np.array([0.3, 0.0, 0.0])))
    (tmp_path / "rig.yaml").write_text(rig_text(rig))
    assert open_sequence(str(path), topics=topics).rig.baseline_m == pytest.approx(0.3)
    with pytest.raises(InputError, match="--topics left="):
        open_sequence(str(path))
