"""EuRoC folders: rectified pairs, the truth of the rig, images without a partner, and what is wrong named."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.types import Camera, is_stereo
from tests.sequences.folders import HEIGHT, START_NS, STEP_NS, WIDTH, make_euroc

REAL = Path(__file__).parents[3] / ".." / "shared" / "data" / "euroc_v1_01_start"


def test_pairs_are_rectified_and_the_rig_sits_between_them(tmp_path: Path) -> None:
    sequence = open_sequence(str(make_euroc(tmp_path)))
    assert sequence.name == "EuRoC V9" and sequence.kinds[:3] == ("stereo", "video", "stereo")
    assert sequence.rig.left == sequence.rig.right and not sequence.rig.left.distortion
    assert sequence.rig.baseline_m == pytest.approx(0.11)
    truth = sequence.truth
    assert truth.times_ns.tolist() == [START_NS + i * STEP_NS for i in range(6)]
    # The body moves along its x axis from (0, 2, 3); the middle between the cameras is at (-0.02, -0.005, 0.01) of it.
    expected = np.array([-0.02, 1.995, 3.01]) + np.outer(np.arange(6) * STEP_NS * 1e-9, [1, 0, 0])
    np.testing.assert_allclose(truth.translations, expected, atol=1e-7)
    np.testing.assert_allclose(truth.rotations[0] @ [1, 0, 0], [0, 1, 0], atol=1e-9)


def test_the_folder_itself_or_the_one_above(tmp_path: Path) -> None:
    above = make_euroc(tmp_path)
    assert open_sequence(str(above / "mav0")).name == open_sequence(str(above)).name


def test_a_camera_alone_keeps_its_distortion(tmp_path: Path) -> None:
    rig = open_sequence(str(make_euroc(tmp_path, right=False))).rig
    assert rig.video == Camera(WIDTH, HEIGHT, 80.0, 80.0, 47.5, 31.5, (-0.05, 0.01, 0.0, 0.0)) and rig.left is None


def test_images_without_a_partner_are_left_out_and_reported(tmp_path: Path) -> None:
    folder = make_euroc(tmp_path)
    listing = folder / "mav0" / "cam1" / "data.csv"
    lines = listing.read_text().splitlines()
    listing.write_text("\n".join([lines[0], *lines[2:4], *lines[5:]]))  # without images 0 and 3
    sequence = open_sequence(str(folder))
    assert sequence.kinds.count("stereo") == 4
    assert (np.diff(sequence.times_ns[np.array(sequence.kinds) == "stereo"]) == np.array([1, 2, 1]) * STEP_NS).all()
    assert "2 of 6 left and 0 of 4 right" in sequence.notes[-1]


def test_a_right_camera_that_stops_half_way_ends_the_pairs_and_is_reported(tmp_path: Path) -> None:
    folder = make_euroc(tmp_path)
    for path in sorted((folder / "mav0" / "cam1" / "data").iterdir())[3:]:
        path.unlink()
    sequence = open_sequence(str(folder))
    assert sequence.kinds.count("stereo") == 3 and sequence[5].time_ns == sequence.times_ns[5]
    assert "3 of 6 images that" in sequence.notes[1] and "3 of 6 left and 0 of 3 right" in sequence.notes[2]


def test_a_truth_of_another_time_is_reported(tmp_path: Path) -> None:
    folder = make_euroc(tmp_path)
    path = folder / "mav0" / "state_groundtruth_estimate0" / "data.csv"
    path.write_text(path.read_text().replace("\n140", "\n130"))
    sequence = open_sequence(str(folder))
    assert sequence.truth is None and "data.csv has no pose" in sequence.notes[-1]


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("cam0/sensor.yaml", "80.0, 80.0", "-80.0, 80.0", "fx is -80, not positive"),
        ("cam0/sensor.yaml", "resolution: [96, 64]", "", "resolution needs 2"),
        ("cam0/sensor.yaml", "radial-tangential", "omni", "distortion_model is omni"),
        ("cam1/sensor.yaml", "0.05, 0, 0, 1", "-0.5, 0, 0, 1", "T_BS does not put cam1 to the right"),
        ("cam1/sensor.yaml", "[0, -1", "[0, -2", "T_BS.data is no rotation"),
        ("cam1/sensor.yaml", "T_BS:", "T_BS: {", "is not valid YAML"),
        ("cam0/data.csv", f"{START_NS + STEP_NS},", "now,", "line 3 is not 'time in nanoseconds"),
        ("cam0/data.csv", f"{START_NS + STEP_NS},", f"{START_NS},", "line 3: time .* is not after"),
        ("cam1/data.csv", ",", ";", "line 2 is not 'time"),
    ],
)
def test_a_mistake_is_named(file: str, old: str, new: str, message: str, tmp_path: Path) -> None:
    folder = make_euroc(tmp_path)
    path = folder / "mav0" / file
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=message) as caught:
        open_sequence(str(folder))
    assert str(path) in str(caught.value)


@pytest.mark.skipif(not REAL.is_dir(), reason="the EuRoC recording is not in ../shared/data")
def test_rows_of_a_real_recording_agree() -> None:
    pair = open_sequence(str(REAL), sensors=None)[0]
    assert is_stereo(pair)
    sift = cv2.SIFT_create(1000)
    (left, of_left), (right, of_right) = (sift.detectAndCompute(image, None) for image in (pair.left, pair.right))
    matches = [a for a, b in cv2.BFMatcher().knnMatch(of_left, of_right, k=2) if a.distance < 0.7 * b.distance]
    offsets = np.array([np.subtract(left[m.queryIdx].pt, right[m.trainIdx].pt) for m in matches])
    assert len(offsets) > 100 and np.median(abs(offsets[:, 1])) <= 0.5
    assert np.median(offsets[:, 0]) > 0


def as_fisheye(folder: Path) -> None:
    for sensor in folder.glob("mav0/*/sensor.yaml"):
        text = sensor.read_text().replace("radial-tangential", "equidistant")
        sensor.write_text(text.replace("[-0.05, 0.01, 0.0, 0.0]", "[0.01, 0.002, -0.001, 0.0]"))


def test_fisheye_lenses_are_read_alone_and_as_a_pair(tmp_path: Path) -> None:
    """As TUM-VI has them (`distortion_model: equidistant`)."""
    alone = make_euroc(tmp_path / "one", right=False)
    as_fisheye(alone)
    camera = open_sequence(str(alone)).rig.camera("video")
    assert camera == Camera(WIDTH, HEIGHT, 80.0, 80.0, 47.5, 31.5, (0.01, 0.002, -0.001, 0.0), "fisheye")
    pair = make_euroc(tmp_path / "two")
    as_fisheye(pair)
    sequence = open_sequence(str(pair))
    assert sequence.rig.baseline_m == pytest.approx(0.11) and sequence.rig.camera("left").lens == "opencv"
    assert is_stereo(sequence[0])


def test_the_truth_of_tum_vi_is_read(tmp_path: Path) -> None:
    folder = make_euroc(tmp_path)
    known = open_sequence(str(folder)).truth
    (folder / "mav0" / "state_groundtruth_estimate0").rename(folder / "mav0" / "mocap0")
    found = open_sequence(str(folder)).truth
    assert known is not None and found is not None
    np.testing.assert_array_equal(known.translations, found.translations)


def test_cameras_that_are_exchanged_are_called_so(tmp_path: Path) -> None:
    folder = make_euroc(tmp_path)
    sensors = [folder / "mav0" / camera / "sensor.yaml" for camera in ("cam0", "cam1")]
    texts = [sensor.read_text() for sensor in sensors]
    for sensor, text in zip(sensors, reversed(texts), strict=True):
        sensor.write_text(text)
    with pytest.raises(InputError, match="exchanged"):
        open_sequence(str(folder))


def test_a_rounded_rotation_is_read_by_the_tolerance_of_all_formats(tmp_path: Path) -> None:
    folder = make_euroc(tmp_path)
    sensor = folder / "mav0" / "cam0" / "sensor.yaml"
    text = sensor.read_text()
    assert "[0, -1, 0" in text
    sensor.write_text(text.replace("[0, -1, 0", "[0, -1.0004, 0"))
    assert open_sequence(str(folder)).rig.has_stereo
    sensor.write_text(text.replace("[0, -1, 0", "[0, -1.0044, 0"))
    with pytest.raises(InputError, match="is no rotation"):
        open_sequence(str(folder))
