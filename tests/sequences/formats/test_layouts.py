"""Layouts of data sets that are known from public documentation: cameras, times and poses have exact values."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.types import Sequence, is_stereo
from tests.sequences.car_folders import (
    DRIVE,
    FIRST,
    make_four_seasons,
    make_icl_nuim,
    make_kitti_360,
    make_robotcar,
)
from tests.sequences.folders import START_NS, STEP_NS, images

WRITTEN = {
    "kitti-360": (make_kitti_360, 0.6),
    "4seasons": (make_four_seasons, 0.3),
    "robotcar": (make_robotcar, 0.239983),
}


def stereo_frames(sequence: Sequence) -> list:
    return [frame for frame in (sequence[i] for i in range(len(sequence))) if is_stereo(frame)]


@pytest.mark.parametrize("name", WRITTEN)
def test_the_pair_has_the_published_camera_and_baseline(name: str, tmp_path: Path) -> None:
    make, baseline_m = WRITTEN[name]
    opened = open_sequence(str(make(tmp_path)))
    camera = opened.rig.camera("left")
    assert (camera.fx, camera.fy, camera.cx, camera.cy, camera.distortion) == (80, 80, 47.5, 31.5, ())
    assert opened.rig.baseline_m == pytest.approx(baseline_m) and opened.guess is None
    frames = stereo_frames(opened)
    assert len(frames) == 6
    for i, frame in enumerate(frames):
        for image, shift in ((frame.left, 8), (frame.right, 0)):
            if name != "robotcar":
                np.testing.assert_array_equal(image if image.ndim == 2 else image[..., 0], images(6, shift)[i])


def test_the_poses_of_kitti_360_are_those_of_the_numbers_of_images(tmp_path: Path) -> None:
    opened = open_sequence(str(make_kitti_360(tmp_path)))
    assert opened.truth is not None
    truth = opened.truth.moved(right=opened.rig.rig_from_left, frame="left")
    numbers = [n for n in range(1, FIRST + 6, 2) if n >= FIRST]
    assert (truth.times_ns - opened.times_ns[0]).tolist() == [(n - FIRST) * 100_000_000 for n in numbers]
    np.testing.assert_allclose(truth.translations[:, 0], numbers, atol=1e-9)


def test_the_poses_of_4seasons_are_in_metres(tmp_path: Path) -> None:
    opened = open_sequence(str(make_four_seasons(tmp_path)))
    assert opened.truth is not None
    truth = opened.truth.moved(right=opened.rig.rig_from_left, frame="left")
    assert truth.times_ns.tolist() == [START_NS + i * STEP_NS for i in (0, 2, 4)]
    np.testing.assert_allclose(truth.translations[:, 0], [0, 2, 4], atol=1e-9)


def test_the_raw_images_of_robotcar_are_made_straight_and_coloured(tmp_path: Path) -> None:
    opened = open_sequence(str(make_robotcar(tmp_path)))
    assert opened.times_ns[0] == START_NS // 1000 * 1000
    left = stereo_frames(opened)[0].left
    assert left.ndim == 3
    raw = images(6, 8)[0].astype(float)
    # GBRG: the first row has green and blue, the second red and green; pixel (u, v) is the raw (u + 2, v + 1).
    green = left[20:50:2, 21:80:2, 1].astype(float)  # raw rows 21, 23 ..., columns 23, 25 ...
    assert np.abs(green - raw[21:51:2, 23:82:2]).mean() < 3
    red = left[20:50:2, 20:80:2, 0].astype(float)  # raw rows 21 ..., columns 22 ...
    assert np.abs(red - raw[21:51:2, 22:82:2]).mean() < 3


def test_icl_nuim_has_the_published_camera_where_the_size_is_that(tmp_path: Path) -> None:
    opened = open_sequence(str(make_icl_nuim(tmp_path)))
    assert opened.guess is None and (opened.rig.camera("video").fx, opened.rig.camera("video").fy) == (481.2, 480.0)
    assert any("gt.freiburg: not used" in str(note) for note in opened.notes)
    other = open_sequence(str(make_icl_nuim(tmp_path / "small", size=(320, 240))))
    assert other.guess is not None and any("give a camera.yaml" in str(note) for note in other.notes)
    (tmp_path / "small" / "living_room_traj0" / "camera.yaml").write_text(
        "{width: 320, height: 240, fx: 240, fy: 240, cx: 160, cy: 120}"
    )
    assert open_sequence(str(tmp_path / "small" / "living_room_traj0")).rig.camera("video").fx == 240


BROKEN: list[tuple[Callable[[Path], Path], str, str | None, str]] = [
    (make_kitti_360, "KITTI-360/calibration/perspective.txt", None, "is missing"),
    (make_kitti_360, f"KITTI-360/data_2d_raw/{DRIVE}/image_00/timestamps.txt", None, "is missing"),
    (make_kitti_360, f"KITTI-360/data_2d_raw/{DRIVE}/image_00/timestamps.txt", "2013-05-28 08:46:02.1\n", "1 times"),
    (
        make_kitti_360,
        f"KITTI-360/data_poses/{DRIVE}/cam0_to_world.txt",
        "1 0 0 0 0 1 0 0 0 0 1 0\n",
        "1 poses for 9 times",
    ),
    (make_four_seasons, "calibration/undistorted_calib_0.txt", None, "is missing"),
    (make_four_seasons, "calibration/undistorted_calib_stereo.txt", "1 0 0 0\n0 1 0 .3\n0 0 1 0\n0 0 0 1\n", "beside"),
    (make_four_seasons, "recording_2020-10-07_14-47-51/GNSSPoses.txt", "5,0,0,0,0,0,0,2,1,1\n", "length 1"),
    (make_robotcar, "models/stereo_wide_left.txt", None, "is missing"),
    (make_robotcar, "models/stereo_wide_left.txt", "80 80\n", "2 numbers"),
    (make_robotcar, "models/stereo_wide_right.txt", "80 80 40 30\n", "not one camera"),
    (make_robotcar, "models/stereo_wide_left_distortion_lut.bin", "1234", "is not for images of"),
]


@pytest.mark.parametrize(("make", "name", "text", "word"), BROKEN)
def test_what_is_missing_or_wrong_is_named(
    make: Callable[[Path], Path], name: str, text: str | None, word: str, tmp_path: Path
) -> None:
    folder = make(tmp_path)
    path = tmp_path / name
    assert path.exists()
    path.unlink() if text is None else path.write_text(text)
    with pytest.raises(InputError, match=word) as caught:
        open_sequence(str(folder))
    assert str(tmp_path) in str(caught.value)
