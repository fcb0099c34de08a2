"""TUM files: exact times, faithful poses, mistakes named by line."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.trajectories import read_tum, tum_text
from ispom.types import Trajectory

GOOD = "0.1 0 0 0 0 0 0 1\n"
reals = st.floats(-1e4, 1e4, allow_subnormal=False)
poses = st.builds(
    lambda r, t: Pose.from_rotvec(np.array(r), np.array(t)),
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.tuples(reals, reals, reals),
)


@given(st.dictionaries(st.integers(-(10**10), 2 * 10**18), poses, max_size=8))
def test_what_is_written_is_read_back(tmp_path_factory: pytest.TempPathFactory, items: dict[int, Pose]) -> None:
    trajectory = Trajectory.of(list(items.items()))
    path = tmp_path_factory.getbasetemp() / "trajectory.tum"
    path.write_text(tum_text(trajectory))
    found = read_tum(path)
    assert found.times_ns.tolist() == trajectory.times_ns.tolist()
    np.testing.assert_allclose(found.translations, trajectory.translations, atol=1e-9)
    np.testing.assert_allclose(found.rotations, trajectory.rotations, atol=1e-8)


def test_the_format_is_nine_decimals() -> None:
    one = Trajectory.of([(1403715529112143517, Pose(translation=np.array([1.5, -0.0, -1e-12])))])
    assert tum_text(one) == (
        "1403715529.112143517 1.500000000 0.000000000 0.000000000 0.000000000 0.000000000 0.000000000 1.000000000\n"
    )


def test_comments_and_scientific_notation_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.tum"
    path.write_text("# time ...\n\n1.403715529112143517e+09 0 0 0 0 0 0 1\n")
    assert read_tum(path).times_ns.tolist() == [1403715529112143517]


def test_of_two_poses_at_one_time_the_last_counts(tmp_path: Path) -> None:
    path = tmp_path / "a.tum"
    path.write_text(GOOD + "0.1 5 0 0 0 0 0 1\n0.2 0 0 0 0 0 0 1\n")
    assert read_tum(path).translations.tolist() == [[5, 0, 0], [0, 0, 0]]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("0.2 0 0 0 0 0 1", "line 2 has 7 columns, not 8"),
        ("0.2 0 nan 0 0 0 0 1", "line 2: 'nan' is not a finite number"),
        ("0.2 0 inf 0 0 0 0 1", "line 2: 'inf' is not a finite number"),
        ("0.2 0 x 0 0 0 0 1", "line 2: 'x' is not a finite number"),
        ("x 0 0 0 0 0 0 1", "line 2: 'x' is not a time"),
        ("nan 0 0 0 0 0 0 1", "line 2: 'nan' is not a time"),
        ("0.05 0 0 0 0 0 0 1", "line 2: time 0.05 is not after"),
        ("0.2 0 0 0 0 0 0 2", "line 2: the quaternion's length is 2"),
    ],
)
def test_a_mistake_is_named(line: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "a.tum"
    path.write_text(GOOD + line)
    with pytest.raises(InputError, match=message) as caught:
        read_tum(path)
    assert str(path) in str(caught.value)


@given(st.binary(max_size=60))
def test_any_bytes_give_a_trajectory_or_a_sentence(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "any.tum"
    path.write_bytes(content)
    try:
        read_tum(path)
    except InputError as error:
        assert str(path) in str(error)
