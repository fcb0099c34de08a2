"""The compiled kernels give the cost and the normal equations of the plain residual family of image points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.geometry import so3_exp
from ispom.solvers.least_squares import Eliminated, NormalEquations, cost, normal_equations
from ispom.solvers.right_camera import PAIR, by_column
from ispom.solvers.window.adjustment import Equations, Window
from ispom.solvers.window.kernels import point_steps
from ispom.solvers.window.observation import robust_cost
from ispom.solvers.window.prior import LENS, POSE
from tests.solvers.window.image_points import problem

POSES, POINTS, SCALE, BASELINE = 7, 120, 3e-4, 0.4


def drive(seed: int, baseline: float) -> Window:
    """Returns a window with errors of about one loss width, some of ten; a fifth of a pair's points has no right x."""
    rng = np.random.default_rng(seed)
    rotations = so3_exp(rng.normal(0, 0.05, (POSES, 3)))
    translations = np.column_stack([rng.normal(0, 0.2, (POSES, 2)), -0.7 * np.arange(POSES)])
    points = rng.uniform((-8, -4, 8), (8, 4, 40), (POINTS, 3))
    count = rng.integers(2, POSES + 1, POINTS)
    cameras = np.concatenate([np.sort(rng.choice(POSES, n, replace=False)) for n in count])
    owners = np.repeat(np.arange(POINTS), count)
    q = np.einsum("kij,kj->ki", rotations[cameras], points[owners]) + translations[cameras]
    seen = np.column_stack([q[:, :2] / q[:, 2:], (q[:, 0] - baseline) / q[:, 2]])
    seen += SCALE * rng.standard_normal(seen.shape) * np.where(rng.uniform(size=(len(q), 1)) < 0.1, 10, 1)
    seen[rng.uniform(size=len(q)) < (0.2 if baseline else 1.0), 2] = np.nan
    right = np.where(np.isfinite(seen[:, 2]), seen[:, 2], seen[:, 0])
    factors = by_column(np.column_stack([right, seen[:, 1]]), seen[:, 0] - right) if baseline else np.zeros((0, LENS))
    extra = rng.normal(0, 1e-3, PAIR if baseline else LENS)
    sigma = np.full(len(extra), 1e100)  # no prior
    return Window(rotations, translations, points, cameras, owners, seen, baseline, extra, sigma, factors)


def eliminated(plain: NormalEquations, baseline: float) -> Eliminated:
    """Eliminates the points; as in the kernels, a share of its trace regularises each block."""
    share = 1e-14 if baseline else 1e-10
    trace = np.trace(plain.blocks, axis1=1, axis2=2)[:, None, None]
    return replace(plain, blocks=plain.blocks + share * trace * np.eye(3)).eliminated(0.0)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("baseline", [0.0, BASELINE], ids=["camera", "pair"])
def test_cost_and_normal_equations_are_those_of_the_family(baseline: float, seed: int) -> None:
    window = drive(seed, baseline)
    plain = problem(window, SCALE)
    assert float(robust_cost(window.squared_errors, SCALE)) == pytest.approx(cost(plain, window), rel=1e-10)
    equations, found = normal_equations(plain, window), Equations.of(window, SCALE)
    wanted = eliminated(equations, baseline)
    diagonal = equations.shared.diagonal()
    unit = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))  # the last corrections change no observation
    assert (np.abs(found.symmetric - wanted.matrix) * np.outer(unit, unit)).max() < 1e-10
    right = -unit * wanted.gradient(equations.shared_gradient, equations.block_gradients)
    np.testing.assert_allclose(unit * found.right, right, atol=1e-10 * np.abs(right).max())


@pytest.mark.parametrize("baseline", [0.0, BASELINE], ids=["camera", "pair"])
def test_the_steps_of_the_points_are_those_of_the_family(baseline: float) -> None:
    window = drive(0, baseline)
    equations, found = normal_equations(problem(window, SCALE), window), Equations.of(window, SCALE)
    wanted = eliminated(equations, baseline)
    shared = 1e-3 * np.random.default_rng(1).standard_normal(len(found.right))
    poses, extra = np.split(shared, [POSE * POSES])
    shown = extra[: window.shown]
    steps = point_steps(window.cameras, window.owners, found.eliminated, poses.reshape(-1, POSE), shown)
    gradients = equations.block_gradients + wanted.mixed @ shared
    expected = -(wanted.inverse @ gradients[..., None])[..., 0]
    np.testing.assert_allclose(steps, expected, rtol=1e-9, atol=1e-10 * np.abs(expected).max())
