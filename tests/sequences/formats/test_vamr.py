"""The recordings of UZH's course: KITTI as it has it, Parking and Malaga, and what is wrong named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.types import Camera
from tests.sequences.folders import HEIGHT, WIDTH, make_malaga, make_parking
from tests.sequences.kitti_folder import make_drive


def test_parking_has_its_matrix_and_poses(tmp_path: Path) -> None:
    sequence = open_sequence(str(make_parking(tmp_path)))
    assert sequence.name == "VAMR parking" and sequence.rig.video == Camera(WIDTH, HEIGHT, 80.0, 78.0, 47.5, 31.5)
    assert sequence.truth is not None
    np.testing.assert_allclose(sequence.truth.translations[:, 0], np.arange(6) / 10, atol=1e-12)
    assert any("30 images per second" in note for note in sequence.notes)


def test_a_missing_image_of_parking_is_a_gap_in_time(tmp_path: Path) -> None:
    folder = make_parking(tmp_path)
    (folder / "images" / "img_00002.png").unlink()
    truth = open_sequence(str(folder)).truth
    assert truth is not None
    np.testing.assert_allclose(truth.times_ns * 3e-9, truth.translations[:, 0], atol=1e-8)


def test_malaga_is_a_pair_whose_principal_points_are_brought_together(tmp_path: Path) -> None:
    sequence = open_sequence(str(make_malaga(tmp_path)))
    assert sequence.name == "Malaga malaga-urban-dataset-extract-07" and sequence.kinds[:2] == ("stereo", "video")
    assert sequence.rig.baseline_m == pytest.approx(0.11932)
    assert sequence.times_ns[0] == 1_261_229_981_580_023_000 and sequence.times_ns[2] - sequence.times_ns[0] > 10**9


def test_malaga_without_its_calibration_is_the_left_camera(tmp_path: Path) -> None:
    folder = make_malaga(tmp_path, frames=3, calibrated=False)
    for given in (folder, next(folder.iterdir())):
        sequence = open_sequence(str(given))
        assert sequence.rig.camera("video").fx == 621.18428 and set(sequence.kinds) == {"video"}
        assert any("published focal length" in note for note in sequence.notes)


def test_poses_of_kitti_beside_the_drive(tmp_path: Path) -> None:
    """kitti/05 and kitti/poses/05.txt, without a folder `sequences`."""
    drive = make_drive(tmp_path)
    moved = drive.rename(drive.parent.parent / drive.name)
    assert open_sequence(str(moved)).truth is not None


@pytest.mark.parametrize(
    ("make", "file", "old", "new", "message"),
    [
        (make_parking, "K.txt", "0,      0,      1,", "0, 0", "K.txt is no camera matrix"),
        (make_parking, "K.txt", "78.0", "-78.0", "fy is -78, not positive"),
        (make_parking, "K.txt", "78.0", "x", "line 2: 'x' is not a finite number"),
        (make_parking, "poses.txt", "1 0 0 0.5 0 1 0 0 0 0 1 0 \n", "", "has 5 poses, but the last image is number 5"),
        (make_malaga, "camera_params_rectified_a=0_96x64.txt", "fx=80.0", "fx=", "CAMERA_LEFT has no fx of 1 number"),
        (
            make_malaga,
            "camera_params_rectified_a=0_96x64.txt",
            "[0.1",
            "[-0.1",
            "not put the right camera to the right",
        ),
        (make_malaga, "camera_params_rectified_a=0_96x64.txt", "[CAMERA_RIGHT]", "[CAMERA_LEFT]", "has no sections"),
    ],
)
def test_a_mistake_is_named(make, file: str, old: str, new: str, message: str, tmp_path: Path) -> None:
    folder = make(tmp_path)
    path = folder / file
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=message) as caught:
        open_sequence(str(folder))
    assert str(folder) in str(caught.value)
