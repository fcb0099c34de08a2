"""EuRoC's ground-truth CSV: nanoseconds, w first, mistakes named by line."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.trajectories import euroc_text, read_euroc
from ispom.types import Trajectory

DATA = Path(__file__).parents[3] / "shared" / "data" / "trajectories"
GOOD = "5,0,0,0,1,0,0,0\n"
poses = st.builds(
    lambda r, t: Pose.from_rotvec(np.array(r), np.array(t)),
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.tuples(*[st.floats(-1e4, 1e4, allow_subnormal=False)] * 3),
)


@given(st.dictionaries(st.integers(-(10**10), 2 * 10**18), poses, max_size=8))
def test_what_is_written_is_read_back(tmp_path_factory: pytest.TempPathFactory, items: dict[int, Pose]) -> None:
    trajectory = Trajectory.of(list(items.items()))
    path = tmp_path_factory.getbasetemp() / "data.csv"
    path.write_text(euroc_text(trajectory))
    found = read_euroc(path, "rig")
    assert found.times_ns.tolist() == trajectory.times_ns.tolist()
    np.testing.assert_allclose(found.translations, trajectory.translations, atol=1e-9)
    np.testing.assert_allclose(found.rotations, trajectory.rotations, atol=1e-8)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("6,0,0,0,1,0,0", "line 2 has 7 columns, not 8"),
        ("6,0,0,0,1,0,0,0,9", "line 2 has 9 columns, not 8"),
        ("6.5,0,0,0,1,0,0,0", "line 2: '6.5' is not a time in whole nanoseconds"),
        ("99999999999999999999,0,0,0,1,0,0,0", "line 2: '9999"),
        ("6,nan,0,0,1,0,0,0", "line 2: 'nan' is not a finite number"),
        ("6,1e30,0,0,1,0,0,0", "line 2: '1e30' is too large"),
        ("4,0,0,0,1,0,0,0", "line 2: time 4 is not after"),
        ("6,0,0,0,1,1,0,0", "line 2: the quaternion's length"),
    ],
)
def test_a_mistake_is_named(line: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    path.write_text(GOOD + line)
    with pytest.raises(InputError, match=message) as caught:
        read_euroc(path)
    assert str(path) in str(caught.value)


@pytest.mark.skipif(not DATA.is_dir(), reason="../shared/data/trajectories is absent")
def test_a_published_file() -> None:
    found = read_euroc(DATA / "V102_groundtruth.csv")
    assert found.frame == "body" and len(found) == 16702 and found.times_ns[0] == 1403715524907143168
    np.testing.assert_allclose(found.translations[0], [0.515356, 1.996773, 0.971104])
    np.testing.assert_allclose(found.xyzw[0], [0.789985, -0.205376, 0.554528, 0.161996], atol=1e-5)
