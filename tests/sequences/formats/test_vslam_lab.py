"""VSLAM-LAB folders: pairs and single cameras, the truth of the body, and what is wrong named."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.types import Camera, is_stereo
from tests.sequences.folders import HEIGHT, START_NS, STEP_NS, WIDTH, images, make_vslam_lab

RAW = Camera(WIDTH, HEIGHT, 80.0, 80.0, 47.5, 31.5, (-0.05, 0.01, 0.0, 0.0))


def test_pairs_are_rectified_and_the_truth_is_that_of_the_body(tmp_path: Path) -> None:
    sequence = open_sequence(str(make_vslam_lab(tmp_path)))
    assert sequence.name == "VSLAM-LAB V9" and sequence.kinds[:3] == ("stereo", "video", "stereo")
    assert sequence.rig.left == sequence.rig.right and not sequence.rig.camera("left").distortion
    assert sequence.rig.baseline_m == pytest.approx(0.11)
    truth = sequence.truth
    assert truth is not None and truth.times_ns.tolist() == [START_NS + i * STEP_NS for i in range(6)]
    expected = np.array([0.055, 2, 3]) + np.outer(np.arange(6) * STEP_NS * 1e-9, [1, 0, 0])  # between the cameras
    np.testing.assert_allclose(truth.translations, expected, atol=1e-7)


def test_images_of_a_rectified_pair_are_not_resampled(tmp_path: Path) -> None:
    frame = open_sequence(str(make_vslam_lab(tmp_path, distorted=False)))[0]
    assert is_stereo(frame)
    np.testing.assert_array_equal(frame.left, images(6, 8)[0])
    np.testing.assert_array_equal(frame.right, images(6, 0)[0])


def test_one_camera_keeps_its_distortion_and_an_empty_truth_is_reported(tmp_path: Path) -> None:
    sequence = open_sequence(str(make_vslam_lab(tmp_path, right=False, truth=False)))
    assert sequence.rig.video == RAW and not sequence.rig.has_stereo
    assert sequence.truth is None and "groundtruth.csv" in sequence.notes[-1]


def test_fisheye_lenses_have_their_name(tmp_path: Path) -> None:
    folder = make_vslam_lab(tmp_path, right=False)
    path = folder / "calibration.yaml"
    path.write_text(path.read_text().replace("radtan4", "equid4"))
    assert open_sequence(str(folder)).rig.camera("video").lens == "fisheye"


def test_a_camera_that_is_not_to_the_right_is_skipped_and_reported(tmp_path: Path) -> None:
    folder = make_vslam_lab(tmp_path)
    path = folder / "calibration.yaml"
    path.write_text(path.read_text().replace("0.1100000000000", "-0.1100000000000"))
    sequence = open_sequence(str(folder))
    assert set(sequence.kinds) == {"video"} and sequence.rig.video == RAW
    assert any("rgb_1" in note and "rgb_0" in note for note in sequence.notes)


@pytest.mark.parametrize("change", ["unknown", "no file"])
def test_without_a_calibration_the_focal_length_is_a_guess(change: str, tmp_path: Path) -> None:
    folder = make_vslam_lab(tmp_path)
    path = folder / "calibration.yaml"
    path.write_text(path.read_text().replace("cam_model: pinhole", "cam_model: unknown"))
    if change == "no file":
        path.unlink()
    sequence = open_sequence(str(folder))
    assert sequence.guess is not None and not sequence.rig.has_stereo
    assert any("a guess" in note for note in sequence.notes)


def test_a_listing_with_an_endless_line_is_refused(tmp_path: Path) -> None:
    folder = make_vslam_lab(tmp_path)
    (folder / "rgb.csv").write_text((folder / "rgb.csv").read_text() + "0," + "x" * 200_000 + "\n")
    with pytest.raises(InputError, match=re.escape("rgb.csv")):
        open_sequence(str(folder))


def test_other_columns_are_skipped_and_paths_may_be_absolute(tmp_path: Path) -> None:
    """As the list of an experiment has masks and depth images, and the adapter's own whole paths."""
    folder = make_vslam_lab(tmp_path, right=False)
    path = folder / "rgb.csv"
    rows = [f"{row.replace('rgb_0/', f'{folder}/rgb_0/')},0,depth_0/0.png" for row in path.read_text().splitlines()[1:]]
    path.write_text("\n".join(["ts_rgb_0 (ns),path_rgb_0,ts_depth_0 (ns),path_depth_0", *rows]))
    assert len(open_sequence(str(folder))) == 6


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("calibration.yaml", "[80.0, 80.0]", "[-80.0, 80.0]", "rgb_0: fx is -80, not positive"),
        ("calibration.yaml", "focal_length", "focus", "rgb_0.focal_length needs 2"),
        ("calibration.yaml", "radtan4", "ftheta", "rgb_0.distortion_type is ftheta"),
        ("calibration.yaml", "T_BS: [1.0", "T_BS: [2.0", "rgb_0.T_BS is no rotation"),
        ("calibration.yaml", "cam_name: rgb_0", "cam_name: left", "has no camera rgb_0, which rgb.csv lists"),
        ("calibration.yaml", "cameras:", "sensors:", "cameras is no list"),
        ("rgb.csv", "path_rgb_", "image_", "rgb.csv has no column path_rgb_0"),
        ("rgb.csv", "ts_rgb_1 (ns)", "ts_rgb_1 (s)", r"no column 'ts_rgb_1 \(ns\)'"),
        ("rgb.csv", f"{START_NS + STEP_NS},rgb_0", "now,rgb_0", "line 3: 'now' is not a time in nanoseconds"),
        ("rgb.csv", f"{START_NS + STEP_NS},rgb_0", f"{START_NS},rgb_0", "line 3: time .* is not after"),
        ("rgb.csv", ",rgb_1/00002.png", "", "line 4 has 3 columns, not 4"),
        ("rgb.csv", "rgb_0/", "nowhere/", "is missing, as all images that"),
    ],
)
def test_a_mistake_is_named(file: str, old: str, new: str, message: str, tmp_path: Path) -> None:
    folder = make_vslam_lab(tmp_path)
    path = folder / file
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=message) as caught:
        open_sequence(str(folder))
    assert str(folder) in str(caught.value)
