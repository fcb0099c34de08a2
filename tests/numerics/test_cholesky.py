"""Symmetric systems against numpy."""

from __future__ import annotations

import numpy as np

from ispom.numerics.cholesky import factor, inverse_factored, solve_factored


def test_solution_and_inverse_are_numpys() -> None:
    rng = np.random.default_rng(0)
    for n in (1, 7, 40):
        root, b = rng.standard_normal((n, n + 3)), rng.standard_normal(n)
        a = root @ root.T
        lower = factor(a)
        np.testing.assert_allclose(lower @ lower.T, a, atol=1e-10)
        np.testing.assert_allclose(solve_factored(lower, b), np.linalg.solve(a, b), rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(inverse_factored(lower), np.linalg.inv(a), rtol=1e-6, atol=1e-9)


def test_what_nothing_is_known_of_stays_finite() -> None:
    a = np.diag([2.0, 0.0, 5.0])
    assert np.isfinite(solve_factored(factor(a), np.array([1.0, 0.0, 1.0]))).all()
