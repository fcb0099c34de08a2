"""Groups of neighbouring tracks, and the inflation by them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ispom.solvers.window.covariance import (
    CELL_OFFSETS,
    IMAGE_CELLS,
    MAX_GROUPS,
    cells,
    cluster_inflation,
    sum_by_group,
)

POSE = 6


def test_sums_by_group() -> None:
    rows = np.random.default_rng(0).normal(size=(7, 2))
    found = sum_by_group(4, np.array([0, 3, 3, 1, 0, 0, 3]), rows)
    np.testing.assert_allclose(found, [rows[[0, 4, 5]].sum(0), rows[3], [0, 0], rows[[1, 2, 6]].sum(0)])


@given(st.integers(1, 60), st.integers(0, 20), st.sampled_from([0.0, 1e-9, 1.0, 600.0]))
def test_neighbours_are_in_one_group_where_the_cells_lie_so(count: int, seed: int, extent: float) -> None:
    seen = extent * np.random.default_rng(seed).uniform(size=(count, 2))
    found = cells(seen)
    assert len(found) == len(CELL_OFFSETS)
    for groups in found:
        assert ((groups >= 0) & (groups < MAX_GROUPS)).all()
        size = np.ptp(seen, axis=0) / IMAGE_CELLS
        for number in groups:
            assert (np.ptp(seen[groups == number], axis=0) <= size * (1 + 1e-6)).all()


def test_a_border_of_one_grouping_is_none_of_the_other() -> None:
    border = (IMAGE_CELLS[0] // 2) / IMAGE_CELLS[0]
    corners, pair = np.array([[0.0, 0.0], [1.0, 1.0]]), np.array([[border - 1e-6, 0.45], [border + 1e-6, 0.45]])
    first, second = cells(np.vstack([corners, pair]))
    assert first[2] != first[3] and second[2] == second[3]


@pytest.mark.parametrize(("tracks", "loud", "alike"), [(20, 0, 1), (60, 0, 1), (60, 8, 1), (90, 0, 3)])
def test_few_tracks_show_less_than_poses_are_off(tracks: int, loud: int, alike: int) -> None:
    """The NEES of an error by the covariance that `tracks` others show: also where `loud` of them are three times as
    large, and where `alike` neighbours have the same."""
    rng, nees = np.random.default_rng(1), list[float]()
    sizes = np.where(np.arange(tracks // alike) < loud, 3.0, 1.0)[:, None]
    for _ in range(2000):
        said, error = (sizes * rng.normal(size=(len(sizes), POSE)) for _ in range(2))
        alone, groups = np.repeat(said, alike, axis=0), alike * said
        square = cluster_inflation(alone, [groups]) * alone.T @ alone
        off = alike * error.sum(axis=0)
        nees.append(float(off @ np.linalg.solve(square, off)))
    assert np.mean(nees) == pytest.approx(POSE, rel=0.1)


def test_of_directions_of_which_nothing_is_said_nothing_follows() -> None:
    said = np.random.default_rng(3).normal(size=(30, POSE)) * (np.arange(POSE) < 4)
    assert 1 <= cluster_inflation(said, [said]) < 2
    assert cluster_inflation(np.zeros((4, POSE)), [np.zeros((2, POSE))]) == 1
