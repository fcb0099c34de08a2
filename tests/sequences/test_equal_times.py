"""Two exposures of one camera at one time have no motion between them: they are refused where they are read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from ispom.errors import InputError
from ispom.sequences import open_sequence
from tests.sequences.folders import make_euroc, make_kitti_raw, make_tum
from tests.sequences.kitti_folder import make_drive
from tests.sequences.own_folders import make_described, make_images


def _same(file: Path, separator: str) -> None:
    """Gives all rows of a file the time of the first one."""
    head = [line for line in file.read_text().splitlines() if line.startswith("#")]
    rows = [line.split(separator) for line in file.read_text().splitlines() if not line.startswith("#")]
    same = [separator.join([rows[0][0], *row[1:]]) for row in rows]
    file.write_text("\n".join([*head, *same]) + "\n")


def _kitti(root: Path) -> Path:
    drive = make_drive(root)
    _same(drive / "times.txt", " ")
    return drive


def _kitti_raw(root: Path) -> Path:
    drive = make_kitti_raw(root)
    for file in drive.glob("image_*/timestamps.txt"):
        first = file.read_text().splitlines()
        file.write_text(f"{first[0]}\n" * len(first))
    return drive


def _euroc(root: Path) -> Path:
    folder = make_euroc(root)
    for file in folder.rglob("cam*/data.csv"):
        _same(file, ",")
    return folder


def _tum(root: Path) -> Path:
    folder = make_tum(root)
    _same(folder / "rgb.txt", " ")
    return folder


def _images(root: Path) -> Path:
    folder = make_images(root)
    (folder / "times.txt").write_text("1.5\n" * 6)
    return folder


def _described(root: Path) -> Path:
    folder = make_described(root)
    for file in folder.glob("*.txt"):
        _same(file, " ")
    return folder


@pytest.mark.parametrize("make", [_kitti, _kitti_raw, _euroc, _tum, _images, _described])
def test_equal_times_of_one_camera_are_refused(make: Callable[[Path], Path], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"line \d+: time "):
        open_sequence(str(make(tmp_path)))
