"""The loop that all adjustments share, on functions whose minimum is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import rosen

from ispom.geometry import Array
from ispom.numerics.levenberg_marquardt import FIRST_DAMPING, LOWEST_DAMPING, minimise


def residuals(x: Array) -> tuple[Array, Array]:
    """Rosenbrock's function as a sum of squares, and the Jacobian."""
    return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]), np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])


def stepped(x: Array, damping: float) -> Array:
    r, j = residuals(x)
    normal = j.T @ j
    return x - np.linalg.solve(normal + damping * np.diag(np.diag(normal)), j.T @ r)


def test_the_minimum_of_rosenbrock_is_found() -> None:
    found = minimise(np.array([-1.2, 1.0]), lambda x: float(rosen(x)), stepped, 100, 0.0)
    np.testing.assert_allclose(found.values, [1, 1], atol=1e-9)
    assert found.cost_before == pytest.approx(24.2) and found.cost < 1e-18 and found.iterations < 100


def test_a_step_that_costs_more_is_forgotten_and_damped_until_none_helps() -> None:
    tried = []

    def worse(x: float, damping: float) -> float:
        tried.append(damping)
        return x + 1

    found = minimise(0.0, lambda x: x, worse, 50, 1e-3, highest=1.0)
    assert found.values == 0.0 and found.cost == 0.0
    np.testing.assert_allclose(tried, FIRST_DAMPING * 30.0 ** np.arange(3))


def test_damping_is_eased_while_steps_help_down_to_its_least() -> None:
    tried = []

    def better(x: float, damping: float) -> float:
        tried.append(damping)
        return x / 2

    found = minimise(1.0, lambda x: x, better, 9, 0.4)
    assert found.iterations == 9 and tried[-1] == LOWEST_DAMPING
    tried.clear()
    minimise(1.0, lambda x: x, better, 9, 0.4, first=1e-7, lowest=1e-12)
    np.testing.assert_allclose(tried, [*(10.0 ** np.arange(-7, -12, -1)), *(4 * [1e-12])])
    assert minimise(1.0, lambda x: x, better, 9, 0.6).iterations == 1, "half is less than the tolerance asks"


def test_a_negative_cost_does_not_end_it() -> None:
    """A prior's gradient makes the cost of a window negative near its minimum."""
    found = minimise(4.0, lambda x: x**2 - 20.0, lambda x, _: x / 2, 60, 1e-12)
    assert found.values < 1e-6
