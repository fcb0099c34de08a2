"""KITTI's text files: poses as (3, 4) matrices, projection matrices, mistakes named."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.kitti import read_calibration, read_poses, read_times

P0 = "P0: 700 0 600 0 0 700 180 0 0 0 1 0\n"


def test_poses_are_read_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    poses = [Pose.from_rotvec(rng.normal(size=3), rng.normal(size=3) * 100) for _ in range(9)]
    np.savetxt(tmp_path / "00.txt", [pose.matrix[:3].ravel() for pose in poses])
    for found, pose in zip(read_poses(tmp_path / "00.txt"), poses, strict=True):
        np.testing.assert_allclose(found.matrix, pose.matrix, atol=1e-12)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1 0 0 0 0 1 0 0 0 0 1", "line 1 has 11 columns"),
        ("1 0 0 nan 0 1 0 0 0 0 1 0", "line 1: 'nan'"),
        ("2 0 0 0 0 1 0 0 0 0 1 0", "line 1: .* not a rotation"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0", "line 1: .* not a rotation"),
    ],
)
def test_a_wrong_pose_is_named(row: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "00.txt").write_text(row)
    with pytest.raises(InputError, match=message):
        read_poses(tmp_path / "00.txt")


def test_times_must_increase(tmp_path: Path) -> None:
    (tmp_path / "times.txt").write_text("0\n1e-1\n0.3\n")
    assert read_times(tmp_path / "times.txt").tolist() == [0, 100_000_000, 300_000_000]
    (tmp_path / "times.txt").write_text("0\n0.1\n0.1\n")
    with pytest.raises(InputError, match=r"times\.txt line 3"):
        read_times(tmp_path / "times.txt")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "no line 'P0"),
        ("P0: 1 2 3", "line 1: P0 needs 12 numbers, not 3"),
        (P0.replace("700", "-700"), "line 1: the focal length is not positive"),
        (P0.replace("700", "nan"), "line 1: 'nan'"),
        (P0 + P0.replace("P0", "P1").replace("700", "0"), "line 2: the focal length"),
    ],
)
def test_a_wrong_calibration_is_named(content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "calib.txt").write_text(content)
    with pytest.raises(InputError, match=message):
        read_calibration(tmp_path / "calib.txt")


def test_other_calibration_entries_are_left_out(tmp_path: Path) -> None:
    (tmp_path / "calib.txt").write_text(P0 + "Tr: 1 2 3\ncalib_time: 09-Jan-2012\n")
    assert list(read_calibration(tmp_path / "calib.txt")) == ["P0"]


@given(st.text(max_size=60))
def test_any_text_gives_values_or_a_sentence(tmp_path_factory: pytest.TempPathFactory, content: str) -> None:
    path = tmp_path_factory.getbasetemp() / "any.txt"
    path.write_text(content, encoding="utf-8", errors="ignore")
    for read in (read_poses, read_times, read_calibration):
        try:
            read(path)
        except InputError as error:
            assert str(path) in str(error)
