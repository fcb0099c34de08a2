"""Trajectory files of any program: the format is seen in the content, and no content ends in a traceback."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ispom.errors import InputError
from ispom.io.poses.recognised import read_trajectory
from ispom.io.whole import write_whole

TUM = "# time x y z qx qy qz qw\n0.1 1 2 3 0 0 0 1\n0.2 1 2 4 0 0 0 1\n"
KITTI = "1 0 0 1 0 1 0 2 0 0 1 3\n1 0 0 1 0 1 0 2 0 0 1 4\n"
EUROC = "#timestamp,p,q\n100000000,1,2,3,1,0,0,0,0.1\n200000000,1,2,4,1,0,0,0,0.1\n"
TEXTS = {"TUM": TUM, "KITTI": KITTI, "EuRoC": EUROC}


@pytest.mark.parametrize("name", TEXTS)
def test_the_format_is_recognised(name: str, tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(TEXTS[name])
    found = read_trajectory(tmp_path / "a.txt")
    assert found.format == name and found.timed == (name != "KITTI")
    assert found.trajectory.translations.tolist() == [[1, 2, 3], [1, 2, 4]]
    times = [0, 10**9] if name == "KITTI" else [10**8, 2 * 10**8]
    assert found.trajectory.times_ns.tolist() == times


def test_rows_get_the_times_they_are_given(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(KITTI)
    found = read_trajectory(tmp_path / "a.txt", np.array([5, 9]))
    assert found.timed and found.trajectory.times_ns.tolist() == [5, 9]
    with pytest.raises(InputError, match="2 poses for 3 times"):
        read_trajectory(tmp_path / "a.txt", np.array([5, 9, 11]))


@pytest.mark.parametrize(
    ("content", "message"),
    [("", "holds no pose"), ("# only\n", "holds no pose"), ("#\n1 2 3\n", "line 2 has 3 columns, which no trajectory")],
)
def test_what_is_no_trajectory_is_refused(content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(content)
    with pytest.raises(InputError, match=message):
        read_trajectory(tmp_path / "a.txt")


WORDS = st.sampled_from(["nan", "-inf", "1e400", "1e14", "-1", "0", "x", "é", "", "1 1", ",", "\n", "#", "9" * 30])


@given(st.sampled_from(sorted(TEXTS)), st.data())
def test_a_mutated_file_gives_a_trajectory_or_a_sentence(
    tmp_path_factory: pytest.TempPathFactory, name: str, data: st.DataObject
) -> None:
    """Words replaced, lines dropped, doubled and swapped, the end cut off, bytes changed."""
    separator = "," if name == "EuRoC" else " "
    lines = [line.split(separator) for line in TEXTS[name].splitlines()]
    for _ in range(data.draw(st.integers(0, 3))):
        line = data.draw(st.integers(0, len(lines) - 1))
        lines[line][data.draw(st.integers(0, len(lines[line]) - 1))] = data.draw(WORDS)
    order = data.draw(st.lists(st.integers(0, len(lines) - 1), max_size=4))
    content = "\n".join(separator.join(lines[i]) for i in order or range(len(lines))).encode()
    content = content[: data.draw(st.integers(0, len(content)))] + data.draw(st.binary(max_size=3))
    path = tmp_path_factory.getbasetemp() / "mutated.txt"
    path.write_bytes(content)
    try:
        found = read_trajectory(path).trajectory
        assert len(found) and np.isfinite(found.translations).all()
    except InputError as error:
        assert str(path) in str(error)


def test_a_file_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    write_whole(tmp_path / "new" / "a.txt", "one")
    write_whole(tmp_path / "new" / "a.txt", b"two")
    assert (tmp_path / "new" / "a.txt").read_text() == "two"
    with pytest.raises(InputError, match="cannot be written"):
        write_whole(tmp_path / "new" / "a.txt" / "below-a-file", "three")
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.txt"]
