"""KITTI drives: what is read, in which frame, and what may be missing."""

from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.sequences.formats.kitti import open_kitti
from ispom.types import StereoPair
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
        assert isinstance(sequence[0], StereoPair)
