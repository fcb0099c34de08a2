"""The folders of ../shared/data/reports: small files of the kinds that people report, each opened right or named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main

from ispom.errors import InputError
from ispom.io.calibrations.recognised import one_camera, one_rig
from ispom.io.poses.recognised import read_trajectory
from ispom.sequences import open_sequence
from ispom.types import Camera, Sequence

REPORTS = Path(__file__).parents[2].parent / "shared" / "data" / "reports"
pytestmark = pytest.mark.skipif(not (REPORTS / "c01_orbslam_settings").is_dir(), reason=f"{REPORTS.name} is not there")

PLAIN = Camera(320, 240, 226.0, 227.5, 160.9, 118.3)
RADTAN = Camera(320, 240, 226.0, 227.5, 160.9, 118.3, (-0.22, 0.06, 0.0006, -0.0004))
SIDE = (460.0, 460.0, 319.5, 239.5)


def values(camera: Camera | None) -> tuple[float, ...]:
    assert camera is not None
    return (camera.fx, camera.fy, camera.cx, camera.cy, *(*camera.distortion, 0, 0, 0, 0)[:4])


CAMERAS = {
    "01_opencv_yaml_as_camera/camera.yaml": RADTAN,
    "c01_orbslam_settings/orbslam2.yaml": RADTAN,
    "c01_orbslam_settings/orbslam3.yaml": RADTAN,
    "c02_vio_settings/vins_pinhole.yaml": RADTAN,
    "c03_bare_matrices/K.txt": PLAIN,
    "c03_bare_matrices/camera_matrix.csv": PLAIN,
    "c03_bare_matrices/droid_calib.txt": RADTAN,
    "c03_bare_matrices/dso_camera.txt": RADTAN,
    "c04_photogrammetry/metashape.xml": Camera(320, 240, 226.0, 226.0, 160.9, 118.3, RADTAN.distortion),
    "c04_photogrammetry/mrcal.cameramodel": RADTAN,
    "c04_photogrammetry/transforms.json": RADTAN,
}
PAIRS = (
    "c01_orbslam_settings/orbslam3_stereo_rectified.yaml",
    "c02_vio_settings/okvis.yaml",
    "c02_vio_settings/stereo.edex",
    "c04_photogrammetry/zed_SN12345.conf",
)


@pytest.mark.parametrize("name", CAMERAS)
def test_a_calibration_has_the_values_of_the_invented_camera(name: str) -> None:
    camera = one_camera(REPORTS / name, lambda: (320, 240))[0]
    assert values(camera) == pytest.approx(values(CAMERAS[name]), abs=1e-9)
    assert (camera.width, camera.height) == (320, 240)


@pytest.mark.parametrize("name", PAIRS)
def test_a_pair_is_0_4_m_wide(name: str) -> None:
    rig = one_rig((REPORTS / name,))[0]
    assert values(rig.left)[:4] == values(rig.right)[:4] == SIDE
    assert rig.baseline_m == pytest.approx(0.4)


BAGS = {
    "b01_realsense_sdk/rec.bag": "",
    "b02_bag_and_camchain/drive.bag": "camchain.yaml",
    "b03_truth_in_bag/truth.bag": "/vrpn_client_node/rig/pose",
    "b04_pair_of_other_names/pair.bag": "by the baseline",
}


@pytest.mark.parametrize("name", BAGS)
def test_the_pair_of_a_bag(name: str) -> None:
    pytest.importorskip("rosbags", reason="the extra `bags` is not installed")
    opened = open_sequence(str(REPORTS / name))
    assert opened.rig.baseline_m == pytest.approx(0.4) and opened.rig.camera("left").fx == 115
    assert (opened.rig.camera("left").width, opened.kinds.count("stereo")) == (160, 6)
    assert any(BAGS[name] in str(note) for note in opened.notes)


def test_the_poses_of_a_bag_are_read() -> None:
    pytest.importorskip("rosbags", reason="the extra `bags` is not installed")
    path = REPORTS / "b03_truth_in_bag" / "truth.bag"
    found = read_trajectory(Path(f"{path}:/vrpn_client_node/rig/pose")).trajectory
    np.testing.assert_allclose(found.translations[:, 0], np.arange(6) / 10, atol=1e-12)


def rate_hz(sequence: Sequence) -> float:
    return 1e9 / float(np.median(np.diff(sequence.times_ns)))


RECORDINGS = {
    "04_image_names_decimal_seconds/names_eighths": (12, 8),
    "05_film_vfr_trimmed/vfr91_trimmed.mp4": (58, 30),
    "12_motion_photo/motion_photo": (12, 30),
    "20_tumvi_equidistant/tumvi_equidistant": (10, 20),
    "28_heic_beside/heic_beside": (6, 15),
    "r01_poses_and_lens_beside": (24, 30),
    "r02_phone_scanner": (24, 30),
    "r03_drone_subtitles": (24, 30),
    "r04_image_names_sec_nsec": (45, 30),
    "r05_times_beside/dso": (12, 10),
    "r05_times_beside/stamps": (12, 10),
    "r06_tum_lists/comma": (8, 30),
    "r06_tum_lists/backslash": (8, 30),
    "r07_layouts/icl": (8, 30),
    "r07_layouts/replica": (8, 30),
    "r07_layouts/scannet": (8, 30),
    "r08_film_kinds/00001.MTS": (24, 30),
    "r08_film_kinds/clip.3gp": (24, 30),
}


@pytest.mark.parametrize("name", RECORDINGS)
def test_a_recording_has_its_images_and_their_times(name: str) -> None:
    opened = open_sequence(str(REPORTS / name))
    count, rate = RECORDINGS[name]
    assert len(opened) == count and rate_hz(opened) == pytest.approx(rate, rel=1e-3)
    assert (np.diff(opened.times_ns) > 0).all()


@pytest.mark.parametrize(
    ("name", "camera"),
    [("r01_poses_and_lens_beside", RADTAN), ("r02_phone_scanner", PLAIN), ("r07_layouts/scannet", PLAIN)],
)
def test_the_lens_and_the_poses_that_lie_beside_are_used(name: str, camera: Camera) -> None:
    opened = open_sequence(str(REPORTS / name))
    assert opened.guess is None and values(opened.rig.video) == pytest.approx(values(camera))
    assert opened.truth is not None and len(opened.truth) == len(opened)


def test_the_poses_of_one_motion_are_the_same_from_every_file_beside() -> None:
    """transforms.json (y up), odometry.csv (quaternions) and ScanNet's matrices: steps and turns, in their cameras."""
    steps = []
    for name in ("r01_poses_and_lens_beside", "r02_phone_scanner", "r07_layouts/scannet", "r07_layouts/replica"):
        truth = open_sequence(str(REPORTS / name)).truth
        assert truth is not None
        steps.append([(truth.pose(i).inverse() @ truth.pose(i + 1)).matrix for i in range(7)])
    for other in steps[1:]:
        np.testing.assert_allclose(other, steps[0], atol=2e-5)


def test_the_focal_length_of_a_drone_is_that_of_its_subtitles() -> None:
    """24 mm: 222 px by the diagonal, as CIPA has it, 213 px by the width; both are within what is said."""
    guess = open_sequence(str(REPORTS / "r03_drone_subtitles")).guess
    assert guess is not None and "SRT" in guess.origin
    assert abs(np.log(guess.focal_px / 213.3)) < guess.sigma


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("c05_size_of_calibration/images", "halve it with --scale-calibration"),
        ("13_bag_uncalibrated/zero_info.bag", "--scale-calibration"),
        ("r09_chapters", "ffmpeg -f concat"),
        ("17_ros_pair/ros_own", "has no known layout"),
    ],
)
def test_what_is_refused_is_named_with_the_cure(name: str, word: str) -> None:
    with pytest.raises(InputError, match=word):
        open_sequence(str(REPORTS / name))


def test_a_calibration_of_twice_the_size_is_halved() -> None:
    opened = open_sequence(str(REPORTS / "c05_size_of_calibration" / "images"), scale_calibration=True)
    assert values(opened.rig.video)[:2] == pytest.approx((226.0, 227.5))


def test_photos_that_are_turned_by_exif_are_opened(capsys: pytest.CaptureFixture[str]) -> None:
    """What ended in a traceback: the last one shares no tracks with three others."""
    assert main(["sources", str(REPORTS / "09_exif_orientation_flips" / "chess_exif3_half")]) == 0
    assert "16 frames" in capsys.readouterr().out


@pytest.mark.parametrize(("name", "aspect"), [("anamorphic91.mp4", 4 / 3), ("square91.mp4", 1.0)])
def test_the_pixels_of_a_film_are_as_wide_as_it_says(name: str, aspect: float) -> None:
    guess = open_sequence(str(REPORTS / "14_anamorphic_film" / name)).guess
    assert guess is not None and guess.aspect == pytest.approx(aspect)


def test_a_bag_whose_stamps_repeat_has_its_own_times() -> None:
    pytest.importorskip("rosbags", reason="the extra `bags` is not installed")
    opened = open_sequence(str(REPORTS / "15_bag_repeated_stamps" / "stamps_same.bag"))
    assert len(opened) == 8 and rate_hz(opened) == pytest.approx(30, rel=0.01)
    grey = open_sequence(str(REPORTS / "26_bag_encodings" / "mono16.bag"))
    assert grey[0].images["video"].dtype == np.uint8 and np.ptp(grey[0].images["video"]) > 50


def test_a_pair_in_colour_is_a_pair() -> None:
    opened = open_sequence(str(REPORTS / "30_kitti_colour" / "kitti_colour"))
    assert opened.rig.baseline_m == pytest.approx(0.531, abs=1e-3) and len(opened) >= 10
