"""KITTI drives: what is read, in which frame, and what may be missing."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.sequences.formats.kitti import open_kitti
from ispom.types import is_stereo
from tests.sequences.kitti_folder import BASELINE_M, HEIGHT, WIDTH, make_drive

KITTI = Path(__file__).parents[4] / "shared" / "data" / "kitti" / "sequences"


def test_a_drive_is_read(tmp_path: Path) -> None:
    recording = open_kitti(make_drive(tmp_path))
    assert recording.name == "KITTI 07"
    assert recording.baseline_m == pytest.approx(BASELINE_M)
    assert (recording.camera.width, recording.camera.height) == (WIDTH, HEIGHT)
    assert recording.times_ns.tolist() == [i * 100_000_000 for i in range(6)]
    left, right = recording.read("left", 2), recording.read("right", 2)
    np.testing.assert_array_equal(left[:, :-8], right[:, 8:])
    assert not left.flags.writeable


def test_truth_is_of_the_rig(tmp_path: Path) -> None:
    """The file says world_from_left; the rig's centre is half a baseline to the right of it."""
    truth = open_sequence(str(make_drive(tmp_path))).truth
    assert truth is not None and truth.frame == "rig"
    np.testing.assert_allclose(truth.translations[3], [0.6 + BASELINE_M / 2, 0, 1.5])


def test_without_right_camera_the_video_is_the_rig(tmp_path: Path) -> None:
    sequence = open_sequence(str(make_drive(tmp_path, right=False)))
    assert set(sequence.kinds) == {"video"} and not sequence.rig.has_stereo and not sequence.notes
    assert sequence.truth is not None
    np.testing.assert_allclose(sequence.truth.translations[3], [0.6, 0, 1.5])


def test_without_poses_there_is_no_truth(tmp_path: Path) -> None:
    assert open_sequence(str(make_drive(tmp_path, poses=False))).truth is None


def test_a_longer_times_file_is_fine(tmp_path: Path) -> None:
    drive = make_drive(tmp_path)
    with (drive / "times.txt").open("a") as times:
        times.write("0.6\n0.7\n")
    assert len(open_kitti(drive).times_ns) == 6


def test_the_folder_above_points_to_its_drives(tmp_path: Path) -> None:
    drive = make_drive(tmp_path)
    for folder in (tmp_path, tmp_path / "sequences"):
        with pytest.raises(InputError, match=f"such as {drive}"):
            open_sequence(str(folder))


def test_the_first_exposures_only(tmp_path: Path) -> None:
    assert len(open_sequence(str(make_drive(tmp_path)), max_exposures=5)) == 5


@pytest.mark.skipif(not KITTI.is_dir(), reason="../shared/data/kitti is absent")
@pytest.mark.parametrize(("drive", "frames", "stereo", "path_m"), [("06", 51, True, 59.9), ("00", 200, False, 144.9)])
def test_real_drives(drive: str, frames: int, stereo: bool, path_m: float) -> None:
    sequence = open_sequence(str(KITTI / drive))
    assert sequence.kinds.count("video") == frames
    assert sequence.rig.has_stereo == stereo
    assert sequence.truth is not None and sequence.truth.length == pytest.approx(path_m, abs=0.1)
    if stereo:
        assert sequence.rig.baseline_m == pytest.approx(0.537, abs=1e-3)
        assert is_stereo(sequence[0])


def in_colour(drive: Path, suffix: str = ".png") -> Path:
    """With image_2 and image_3 in place of the grey ones; the left one is 0.06 m to the left of image_0."""
    for grey, colour in (("image_0", "image_2"), ("image_1", "image_3")):
        (drive / colour).mkdir()
        for path in sorted((drive / grey).iterdir()):
            image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            assert image is not None
            cv2.imwrite(str(drive / colour / f"{path.stem}{suffix}"), np.dstack([image, image, 255 - image]))
            path.unlink()
        (drive / grey).rmdir()
    rows = [f"P{i}: 80 0 47.5 {80 * (0.06 - BASELINE_M * (i - 2))} 0 80 31.5 0.8 0 0 1 0" for i in (2, 3)]
    with (drive / "calib.txt").open("a") as file:
        file.write("\n".join(rows) + "\n")
    return drive


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_drive_in_colour_is_read(suffix: str, tmp_path: Path) -> None:
    recording = open_kitti(in_colour(make_drive(tmp_path), suffix))
    assert recording.baseline_m == pytest.approx(BASELINE_M)
    left, right = recording.read("left", 2), recording.read("right", 2)
    assert left.shape == (HEIGHT, WIDTH, 3)
    grey = open_kitti(make_drive(tmp_path / "grey")).read("left", 2)
    np.testing.assert_allclose(left[..., 1], grey, atol=0 if suffix == ".png" else 60)
    np.testing.assert_allclose(left[..., 0], 255 - grey.astype(int), atol=0 if suffix == ".png" else 60)
    assert right.shape == left.shape
    assert recording.truth is not None  # of the grey camera in the file
    np.testing.assert_allclose(recording.truth.translations[3], [0.6 - 0.06, -0.01, 1.5], atol=1e-12)


def test_copies_in_another_format_are_read(tmp_path: Path) -> None:
    drive = make_drive(tmp_path)
    before = open_kitti(drive).read("left", 3)
    for path in sorted((drive / "image_0").iterdir()):
        cv2.imwrite(str(path.with_suffix(".jpg")), cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))  # type: ignore[arg-type]
    np.testing.assert_array_equal(open_kitti(drive).read("left", 3), before)
    for path in (drive / "image_0").glob("*.png"):
        path.unlink()
    after = open_kitti(drive).read("left", 3)
    assert after.shape == before.shape and np.abs(after.astype(int) - before).mean() < 10
    (drive / "image_0" / "000002.jpg").unlink()
    with pytest.raises(InputError, match=r"000002\.jpg is missing"):
        open_kitti(drive)


def test_a_drive_in_colour_needs_the_calibration_of_its_cameras(tmp_path: Path) -> None:
    drive = in_colour(make_drive(tmp_path))
    (drive / "calib.txt").write_text("P0: 80 0 47.5 0 0 80 31.5 0 0 0 1 0\n")
    with pytest.raises(InputError, match=r"no line 'P2: \.\.\.'"):
        open_kitti(drive)
