"""KITTI raw drives: rectified or not, grey or in colour, and what is wrong named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.types import Camera, is_stereo
from tests.sequences.folders import HEIGHT, WIDTH, images, make_kitti_raw

FIRST_NS = 1_317_042_145_000_000_000
"""2011-09-26 13:02:25 UTC."""


@pytest.mark.parametrize("colour", [False, True])
def test_a_synchronised_drive_is_read_as_it_is(colour: bool, tmp_path: Path) -> None:
    sequence = open_sequence(str(make_kitti_raw(tmp_path, colour=colour)), sensors=None)
    assert sequence.rig.left == Camera(WIDTH, HEIGHT, 80.0, 80.0, 47.5, 31.5)
    assert sequence.rig.baseline_m == pytest.approx(0.5)
    assert sequence.truth is not None and any("GPS/IMU" in note for note in sequence.notes)
    assert (sequence.times_ns[::2] == FIRST_NS + np.arange(6) * 100_000_000).all()
    pair = sequence[4]
    assert is_stereo(pair)
    np.testing.assert_array_equal(pair.left, images(6, 8)[2])
    np.testing.assert_array_equal(pair.right, images(6, 0)[2])


def test_an_unrectified_drive_is_rectified(tmp_path: Path) -> None:
    pair = open_sequence(str(make_kitti_raw(tmp_path, raw=True)), sensors=None)[0]
    assert is_stereo(pair) and pair.left.shape == (HEIGHT, WIDTH)
    middle = np.s_[24:40, 40:56]  # where the distortion does nothing
    difference = pair.left[middle].astype(float) - images(6, 8)[0][middle]
    assert abs(difference).mean() < 3


def test_an_image_that_one_side_lacks_is_left_out_and_reported(tmp_path: Path) -> None:
    drive = make_kitti_raw(tmp_path)
    (drive / "image_01" / "data" / "0000000002.png").unlink()
    sequence = open_sequence(str(drive))
    assert sequence.kinds.count("stereo") == 5 and "1 of 6 left" in sequence.notes[1]


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("../calib_cam_to_cam.txt", "P_rect_01: 80", "P_rect_01: -80", "line 13: the focal length is not positive"),
        ("../calib_cam_to_cam.txt", "K_00: 80", "K_00: x", "line 3: 'x' is not a finite number"),
        ("../calib_cam_to_cam.txt", "D_00: -0.05", "D_00:", "line 4: D_00 needs 5 numbers, not 4"),
        ("../calib_cam_to_cam.txt", "R_rect_01", "R_rect_09", "no line 'R_rect_01"),
        ("../calib_cam_to_cam.txt", "-38", "38", "not the left one moved to the right"),
        ("../calib_cam_to_cam.txt", "96 64", "97 64", "0000000000.png is 96 x 64, which is not in"),
        ("image_00/timestamps.txt", "2011-09-26 13:02:25.1", "2011-99-26 13:02:25.1", "line 2: .* is not a date"),
        ("image_00/timestamps.txt", ":25.1", ":24.1", "line 2: time .* is not after"),
        ("image_00/timestamps.txt", "2011-09-26 13:02:25.500000000", "", "has 5 times, none for image 0000000005"),
        ("oxts/data/0000000002.txt", " 100 ", " nan ", "line 1: 'nan' is not a finite number"),
        ("oxts/data/0000000002.txt", "0 8.", "100 8.", "is not a latitude"),
        ("oxts/data/0000000002.txt", " 100 ", " ", "has 29 values, not 30"),
        ("oxts/timestamps.txt", "2011-09-26 13:02:25.500000000", "", "has 5 times, none for"),
        ("../calib_imu_to_velo.txt", "R: 1", "R: 2", "line 2: R is not a rotation"),
        ("../calib_velo_to_cam.txt", "T:", "S:", "no line 'T: ...'"),
    ],
)
def test_a_mistake_is_named(file: str, old: str, new: str, message: str, tmp_path: Path) -> None:
    drive = make_kitti_raw(tmp_path)
    path = (drive / file).resolve()
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=message) as caught:
        open_sequence(str(drive))
    assert str(path) in str(caught.value)


def test_the_truth_is_the_track_of_the_unit_carried_to_the_rig(tmp_path: Path) -> None:
    sequence = open_sequence(str(make_kitti_raw(tmp_path)))
    truth = sequence.truth
    assert truth is not None and len(truth) == 6
    # World: x east, y north, z up. The rig looks east, its x axis south, its y axis down.
    np.testing.assert_allclose(truth.rotations[3], [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-6)
    # The unit is at (i, 0, 0). The camera sees the laser at (0, -0.1, -0.3) and the laser the unit at (-0.5, 0, -0.8):
    # the camera is 0.3 m ahead of the laser and 0.1 m below it, so 0.8 m ahead of the unit and 0.7 m above it.
    # P_rect puts the left camera 2 / 80 m further to the left, and the rig is half the baseline of 0.5 m right of it.
    expected = np.stack([np.arange(6) + 0.8, np.full(6, 0.025 - 0.25), np.full(6, 0.7)], axis=1)
    np.testing.assert_allclose(truth.translations, expected, atol=1e-6)


def test_samples_that_come_late_or_twice_are_left_out(tmp_path: Path) -> None:
    drive = make_kitti_raw(tmp_path)
    stamps = drive / "oxts" / "timestamps.txt"
    stamps.write_text(stamps.read_text().replace(":25.300", ":25.100"))
    truth = open_sequence(str(drive)).truth
    assert truth is not None and len(truth) == 6
    np.testing.assert_allclose(np.diff(truth.translations[:, 0]), 1, atol=1e-6)  # interpolated over the one left out


@pytest.mark.parametrize(
    ("missing", "told"),
    [("oxts", "no GPS/IMU track"), ("../calib_imu_to_velo.txt", "calib_imu_to_velo.txt is missing, without which")],
)
def test_without_track_or_its_calibration_there_is_no_truth(missing: str, told: str, tmp_path: Path) -> None:
    drive = make_kitti_raw(tmp_path)
    (drive / missing).rename(tmp_path / "away")
    sequence = open_sequence(str(drive))
    assert sequence.truth is None and any(told in note for note in sequence.notes)


def test_a_drive_without_its_calibration(tmp_path: Path) -> None:
    drive = make_kitti_raw(tmp_path)
    (drive.parent / "calib_cam_to_cam.txt").unlink()
    with pytest.raises(InputError, match=r"calib_cam_to_cam\.txt is missing"):
        open_sequence(str(drive))
