"""Short reductions give numpy's own numbers, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.numerics.reductions import both, lengths, median, squares


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_lengths_are_those_of_numpy(kind: type) -> None:
    rows = np.random.default_rng(0).normal(0, 100, (500, 2)).astype(kind)
    assert lengths(rows).dtype == kind
    np.testing.assert_array_equal(lengths(rows), np.linalg.norm(rows, axis=1))
    np.testing.assert_array_equal(squares(rows), (rows**2).sum(axis=1))


def test_both_is_all_of_a_row() -> None:
    rows = np.array([[True, True], [True, False], [False, True], [False, False]])
    assert both(rows).tolist() == rows.all(axis=1).tolist()


@pytest.mark.parametrize("count", [1, 2, 3, 4, 101, 500])
def test_a_median_is_that_of_numpy(count: int) -> None:
    values = np.random.default_rng(count).normal(size=count)
    assert median(values) == np.median(values)
    assert median(np.round(values)) == np.median(np.round(values))
