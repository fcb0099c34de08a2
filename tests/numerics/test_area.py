"""Weights by area, and the median that goes with them."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ispom.numerics.area import area_weights, weighted_median


def test_a_dense_cluster_counts_as_the_area_that_it_covers() -> None:
    rng = np.random.default_rng(0)
    wide = np.stack(np.meshgrid(np.linspace(0.01, 0.99, 16), np.linspace(0.01, 0.99, 16)), 2).reshape(-1, 2)
    dense = rng.uniform((0.26, 0.26), (0.37, 0.37), (1000, 2))
    weights = area_weights(np.concatenate([wide, dense]))
    assert weights.sum() == 64.0, "8 by 8 cells, all with points"
    assert weights[256:].sum() < 1.0


def test_points_in_one_place_are_one_cell() -> None:
    assert area_weights(np.zeros((5, 2))).sum() == 1.0


@given(st.lists(st.tuples(st.floats(-9, 9), st.integers(1, 4)), min_size=1, max_size=30))
def test_a_weight_is_a_value_so_often(items: list[tuple[float, int]]) -> None:
    values, counts = np.array([v for v, _ in items]), np.array([float(n) for _, n in items])
    repeated = np.sort(np.repeat(values, counts.astype(int)))
    assert weighted_median(values, counts) == repeated[(len(repeated) - 1) // 2]
