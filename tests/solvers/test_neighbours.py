"""Groups of neighbours in the image."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ispom.solvers.neighbours import CELLS, GROUPS, POSE, SHIFTS, by_group, cells, left_open


def test_sums_by_group() -> None:
    rows = np.random.default_rng(0).normal(size=(7, 2))
    found = by_group(4, np.array([0, 3, 3, 1, 0, 0, 3]), rows)
    np.testing.assert_allclose(found, [rows[[0, 4, 5]].sum(0), rows[3], [0, 0], rows[[1, 2, 6]].sum(0)])


@given(st.integers(1, 60), st.integers(0, 20), st.sampled_from([0.0, 1e-9, 1.0, 600.0]))
def test_neighbours_are_in_one_group_where_the_cells_lie_so(count: int, seed: int, extent: float) -> None:
    seen = extent * np.random.default_rng(seed).uniform(size=(count, 2))
    found = cells(seen)
    assert len(found) == len(SHIFTS)
    for groups in found:
        assert ((groups >= 0) & (groups < GROUPS)).all()
        size = np.ptp(seen, axis=0) / CELLS
        for number in groups:
            assert (np.ptp(seen[groups == number], axis=0) <= size * (1 + 1e-6)).all()


def test_a_border_of_one_grouping_is_none_of_the_other() -> None:
    border = (CELLS[0] // 2) / CELLS[0]
    corners, pair = np.array([[0.0, 0.0], [1.0, 1.0]]), np.array([[border - 1e-6, 0.45], [border + 1e-6, 0.45]])
    first, second = cells(np.vstack([corners, pair]))
    assert first[2] != first[3] and second[2] == second[3]


@pytest.mark.parametrize("groups", [12, 30])
def test_few_groups_show_less_than_poses_are_off(groups: int) -> None:
    """The mean of the square of an error, by the covariance that so many others show."""
    rng, nees = np.random.default_rng(1), list[float]()
    for _ in range(4000):
        said = rng.normal(size=(groups, POSE))
        error = rng.normal(size=POSE)
        nees.append(float(error @ np.linalg.solve(left_open(groups) * said.T @ said / groups, error)))
    assert np.mean(nees) == pytest.approx(POSE, rel=0.06)
