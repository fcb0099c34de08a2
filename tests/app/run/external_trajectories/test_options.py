"""What the flags --beside and --beside-alignment name, and every mistake in them."""

from __future__ import annotations

from pathlib import Path

import pytest
from ispom_app.engine.external_trajectories.placed import read_options

from ispom.errors import InputError
from tests import doubles
from tests.app.run.external_trajectories.made import elsewhere, written


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return written(tmp_path / "orb.tum", elsewhere(doubles.sequence(20)))


def test_name_frame_file_and_alignment_are_read(path: Path) -> None:
    a, b = read_options([f"ORB-SLAM3:left={path}", f"lib={path}"], ["lib=sim3"])
    assert (a.name, a.frame, a.alignment, a.file.format) == ("ORB-SLAM3", "left", "se3", "TUM")
    assert (b.name, b.frame, b.alignment) == ("lib", "rig", "sim3")


MISTAKES = {
    "orb": "give NAME=FILE",
    "orb=": "give NAME=FILE",
    "orb:board={path}": "one of rig, left, right, video",
    "1={path}": "use letters, digits",
    "a/b={path}": "use letters, digits",
    "stereo={path}": "as a method is called",
    "Stereo={path}": "as a method is called",
    "truth={path}": "as the ground truth is called",
    "orb={path}.no": "is missing",
    "orb={unknown}": "which no trajectory has",
}


@pytest.mark.parametrize("flag", MISTAKES)
def test_a_mistake_is_one_sentence(path: Path, tmp_path: Path, flag: str) -> None:
    (tmp_path / "unknown.txt").write_text("1 2 3\n")
    with pytest.raises(InputError, match=MISTAKES[flag]) as found:
        read_options([flag.format(path=path, unknown=tmp_path / "unknown.txt")], [])
    assert "\n" not in str(found.value)


def test_one_name_for_two_files_is_refused(path: Path) -> None:
    with pytest.raises(InputError, match="another trajectory"):
        read_options([f"orb={path}", f"ORB={path}"], [])


@pytest.mark.parametrize("alignment", ["orb", "orb=", "orb=best", "lib=se3"])
def test_an_alignment_must_be_known_and_of_a_trajectory(path: Path, alignment: str) -> None:
    with pytest.raises(InputError, match="--beside-alignment is"):
        read_options([f"orb={path}"], [alignment])
