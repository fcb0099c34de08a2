"""Normal equations with blocks against a dense solver, and derivatives against differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from ispom.calibration.adjust.problem import BoardProblem, Observations, Unknowns
from ispom.calibration.adjust.solve import with_views
from ispom.calibration.least_squares import (
    Loss,
    Problem,
    adjust,
    cauchy,
    cost,
    huber,
    normal_equations,
    quadratic,
)
from ispom.calibration.targets.layouts import parse_target
from ispom.calibration.tracked.scene import Prior, Scene, SceneProblem
from ispom.simulation.filmed_board import LEFT, board_poses
from tests.calibration.corners import seen_by
from tests.calibration.tracked.scenes import tracks


def board_problem() -> tuple[Problem[Any], Any]:
    target = parse_target("aprilgrid:4x4:0.03:0.3")
    detections = seen_by(target, LEFT, board_poses(LEFT, target.size_m, 5, 1), np.random.default_rng(1))
    seen = Observations.of(target, [detections])
    start = with_views(LEFT, seen)
    return BoardProblem(seen, Unknowns.all_of(start), start.views), start


def scene_problem() -> tuple[Problem[Any], Any]:
    rng, seen = np.random.default_rng(0), tracks(0, views=5, points=40)
    points = rng.normal(0, 1, (seen.points, 4)) * (1, 1, 0.2, 0.1) + (0, 0, 2, 0.3)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    lens = np.array([np.log(400.0), 370.0, 240.0, -0.1, 0.02])
    scene = Scene(lens, np.tile(np.eye(3), (5, 1, 1)), 0.1 * rng.normal(0, 1, (5, 3)), points)
    prior = Prior(lens + 0.01, np.array([0.3, 10, 0.0, 0.2, 0.1]))
    return SceneProblem(scene, seen.observations, prior, 50.0), scene


PROBLEMS = pytest.mark.parametrize("made", [board_problem, scene_problem])


@PROBLEMS
@pytest.mark.parametrize("loss", [quadratic, cauchy, huber(1.0)])
def test_gradients_are_those_of_the_cost(made: Any, loss: Loss) -> None:
    problem, values = made()
    equations, rng = normal_equations(problem, values, loss), np.random.default_rng(2)
    for _ in range(5):
        shared, blocks = 1e-7 * rng.normal(size=problem.shared), 1e-7 * rng.normal(size=equations.block_gradients.shape)
        ends = [cost(problem, problem.moved(values, sign * shared, sign * blocks), loss) for sign in (1, -1)]
        slope = shared @ equations.shared_gradient + (blocks * equations.block_gradients).sum()
        assert (ends[0] - ends[1]) / 2 == pytest.approx(slope, rel=1e-4)


@PROBLEMS
@pytest.mark.parametrize("damping", [0.0, 1e-3])
def test_the_step_is_that_of_all_unknowns_together(made: Any, damping: float) -> None:
    problem, values = made()
    equations = normal_equations(problem, values, quadratic)
    if made is scene_problem:
        damping = max(damping, 1e-6)  # the scale of a scene is free
    own = equations.block_gradients.size
    full = np.zeros((problem.shared + own, problem.shared + own))
    full[: problem.shared, : problem.shared] = equations.shared
    full[problem.shared :, : problem.shared] = equations.mixed.reshape(own, -1)
    full[: problem.shared, problem.shared :] = full[problem.shared :, : problem.shared].T
    size = equations.blocks.shape[1]
    for n, block in enumerate(equations.blocks):
        at = problem.shared + n * size
        full[at : at + size, at : at + size] = block
    full += damping * np.diag(np.diag(full))
    gradient = np.concatenate([equations.shared_gradient, equations.block_gradients.ravel()])
    shared, blocks = equations.step(damping)
    np.testing.assert_allclose(
        full @ np.concatenate([shared, blocks.ravel()]), -gradient, atol=1e-6 * abs(gradient).max()
    )


def test_the_minimum_is_that_of_a_general_solver() -> None:
    problem, start = board_problem()
    found = adjust(problem, start, quadratic, 50, 1e-12)
    blocks = normal_equations(problem, start).block_gradients.shape

    def residuals(x: np.ndarray) -> np.ndarray:
        moved = problem.moved(start, x[: problem.shared], x[problem.shared :].reshape(blocks))
        return (problem.residuals(moved) / problem.widths[:, None]).ravel()

    general = least_squares(
        residuals, np.zeros(problem.shared + np.prod(blocks)), x_scale="jac", xtol=1e-12, ftol=1e-12
    )
    assert found.cost == pytest.approx(general.cost, rel=1e-8)
