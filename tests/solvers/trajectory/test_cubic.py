"""The curve is the one and only, and passes through its values to the bit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from ispom.solvers.trajectory.cubic import cubic_at


@pytest.mark.parametrize("count", [2, 3, 4, 5, 40])
@pytest.mark.parametrize("seed", range(3))
def test_as_scipys(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    knots, values = np.cumsum(rng.uniform(0.02, 2, count)), rng.normal(size=(count, 3))
    asked = np.concatenate([rng.uniform(knots[0], knots[-1], 50), knots])
    found = cubic_at(knots, values, asked)
    np.testing.assert_allclose(found, make_interp_spline(knots, values, k=min(3, count - 1))(asked), atol=1e-11)
    np.testing.assert_array_equal(found[50:-1], values[:-1])


def test_a_cubic_is_met_exactly() -> None:
    knots, asked = np.array([0.0, 0.5, 2, 3, 3.5]), np.linspace(0, 3.5, 30)
    cubics = np.array([[1.0, -2, 0.5, 3], [0, 1, 0, -1]]).T
    found = cubic_at(knots, np.vander(knots, 4) @ cubics, asked)
    np.testing.assert_allclose(found, np.vander(asked, 4) @ cubics, atol=1e-12)
