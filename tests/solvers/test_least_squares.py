"""Normal equations with blocks against a dense solver, and derivatives against differences."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from ispom.calibration.adjust.lens import vector_of
from ispom.calibration.adjust.problem import Observations, Unknowns, board_problem
from ispom.calibration.adjust.solve import with_views
from ispom.calibration.targets.layouts import parse_target
from ispom.calibration.tracked.scene import LensPrior, Scene, scene_problem
from ispom.numerics.robust import robust_loss
from ispom.simulation.filmed_board import LEFT, board_poses
from ispom.solvers.least_squares import (
    SETTLED,
    Derivatives,
    Family,
    Loss,
    NormalEquations,
    Prior,
    Problem,
    adjust,
    cost,
    huber,
    normal_equations,
    quadratic,
)
from tests.calibration.corners import seen_by
from tests.calibration.tracked.scenes import tracks


def of_board(loss: Loss) -> tuple[Problem[Any], Any]:
    target = parse_target("aprilgrid:4x4:0.03:0.3")
    detections = seen_by(target, LEFT, board_poses(LEFT, target.size_m, 5, 1), np.random.default_rng(1))
    seen = Observations.of(target, [detections])
    start = with_views(LEFT, seen)
    return board_problem(seen, Unknowns.all_of(start), start.views, loss), start


def of_scene(loss: Loss) -> tuple[Problem[Any], Any]:
    rng, seen = np.random.default_rng(0), tracks(0, views=5, points=40)
    points = rng.normal(0, 1, (seen.points, 4)) * (1, 1, 0.2, 0.1) + (0, 0, 2, 0.3)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    lens = np.array([np.log(400.0), 370.0, 240.0, -0.1, 0.02])
    scene = Scene(lens, np.tile(np.eye(3), (5, 1, 1)), 0.1 * rng.normal(0, 1, (5, 3)), points)
    prior = LensPrior(lens + 0.01, np.array([0.3, 10, 0.0, 0.2, 0.1]))
    problem = scene_problem(scene, seen.observations, prior, 50.0)
    points, lens = problem.families
    return replace(problem, families=(replace(points, loss=loss), lens)), scene


PROBLEMS = pytest.mark.parametrize("made", [of_board, of_scene])


@PROBLEMS
@pytest.mark.parametrize("loss", [quadratic, robust_loss, huber(1.0)])
def test_gradients_are_those_of_the_cost(made: Any, loss: Loss) -> None:
    problem, values = made(loss)
    equations, rng = normal_equations(problem, values), np.random.default_rng(2)
    for _ in range(5):
        shared, blocks = 1e-7 * rng.normal(size=problem.shared), 1e-7 * rng.normal(size=equations.block_gradients.shape)
        ends = [cost(problem, problem.moved(values, sign * shared, sign * blocks)) for sign in (1, -1)]
        slope = shared @ equations.shared_gradient + (blocks * equations.block_gradients).sum()
        assert (ends[0] - ends[1]) / 2 == pytest.approx(slope, rel=1e-4)


@PROBLEMS
@pytest.mark.parametrize("damping", [0.0, 1e-3])
def test_the_step_is_that_of_all_unknowns_together(made: Any, damping: float) -> None:
    problem, values = made(quadratic)
    equations = normal_equations(problem, values)
    if made is of_scene:
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
    problem, start = of_board(quadratic)
    found = adjust(problem, start, 50, 1e-12)
    blocks = normal_equations(problem, start).block_gradients.shape

    def residuals(x: np.ndarray) -> np.ndarray:
        moved = problem.moved(start, x[: problem.shared], x[problem.shared :].reshape(blocks))
        (corners,) = problem.families
        return (corners.residuals(moved) / corners.widths[:, None]).ravel()

    general = least_squares(
        residuals, np.zeros(problem.shared + np.prod(blocks)), x_scale="jac", xtol=1e-12, ftol=1e-12
    )
    assert found.cost == pytest.approx(general.cost, rel=1e-8)


@dataclass(frozen=True, eq=False)
class Distances(Family[np.ndarray]):
    """A term that nobody else knows of: points of a chain are so far apart, in one number and without a block."""

    measured: np.ndarray
    widths: np.ndarray
    loss: Loss = robust_loss

    def residuals(self, values: np.ndarray) -> np.ndarray:
        return (np.linalg.norm(np.diff(values, axis=0), axis=1) - self.measured)[:, None]

    def derivatives(self, values: np.ndarray) -> Derivatives:
        way = np.diff(values, axis=0)
        along = way / np.linalg.norm(way, axis=1, keepdims=True)
        columns = 3 * np.arange(len(way))[:, None] + np.arange(6)
        return Derivatives.of_shared(np.concatenate([-along, along], axis=1)[:, None], columns)


def test_a_new_term_is_one_family() -> None:
    """Priors of three coordinates, and distances along the chain: the minimum is that of a general solver."""
    rng = np.random.default_rng(3)
    values, mean = rng.normal(size=(5, 3)), rng.normal(size=15)
    near = Prior[np.ndarray](lambda v: v.ravel() - mean, rng.uniform(0.5, 2, 15), np.arange(15))
    distances = Distances(rng.uniform(0.5, 2, 4), rng.uniform(0.1, 0.5, 4))
    problem = Problem((near, distances), lambda v, shared, _: v + shared.reshape(v.shape), 15)
    found = adjust(problem, values, 100, 1e-14)

    def residuals(x: np.ndarray) -> np.ndarray:
        v = x.reshape(5, 3)
        robust = np.sqrt(robust_loss((distances.residuals(v)[:, 0] / distances.widths) ** 2)[0])
        return np.concatenate([near.away(v) / near.widths, robust])

    assert found.cost == pytest.approx(least_squares(residuals, found.values.ravel(), xtol=1e-14).cost, rel=1e-9)
    information = normal_equations(problem, found.values)
    assert np.linalg.norm(information.shared_gradient) < 1e-5 and information.mixed.size == 0


def test_covariances_of_blocks_are_those_of_all_unknowns_together() -> None:
    problem, values = of_board(quadratic)
    equations = normal_equations(problem, values)
    reduced = equations.eliminated(0.0)
    covariance = np.linalg.inv(reduced.matrix)
    own = equations.block_gradients.size
    mixed = equations.mixed.reshape(own, -1)
    blocks = np.zeros((own, own))
    for n, block in enumerate(equations.blocks):
        blocks[6 * n : 6 * n + 6, 6 * n : 6 * n + 6] = block
    whole = np.linalg.inv(np.block([[equations.shared, mixed.T], [mixed, blocks]]))[problem.shared :, problem.shared :]
    for n, block in enumerate(reduced.block_covariances(covariance)):
        expected = whole[6 * n : 6 * n + 6, 6 * n : 6 * n + 6]
        np.testing.assert_allclose(block, expected, atol=1e-6 * abs(expected).max())


def test_blocks_that_are_singular_but_for_their_damping_are_eliminated() -> None:
    """As of points on whose distance the residuals say nothing, a few of which stopped a film's self-calibration."""
    rng, count = np.random.default_rng(0), 500
    slopes = rng.normal(size=(count, 2, 3)) * np.array([[1.5e3], [1.0]])
    blocks, mixed = np.swapaxes(slopes, 1, 2) @ slopes, np.swapaxes(slopes, 1, 2) @ rng.normal(size=(count, 2, 4))
    equations = NormalEquations(1e9 * np.eye(4), mixed, blocks, np.zeros((count, 4)), np.zeros(4), np.zeros((count, 3)))
    reduced = equations.eliminated(1e-12)
    assert np.linalg.eigvalsh(reduced.inverse).min() >= 0 and np.isfinite(reduced.matrix).all()


def test_an_adjustment_ends_where_what_is_asked_for_has_settled() -> None:
    problem, exact = of_board(robust_loss)
    start = problem.moved(exact, np.full(problem.shared, 1e-3), np.zeros((problem.blocks, problem.size)))
    whole = adjust(problem, start, 200, 1e-15)
    settled = adjust(problem, start, 200, 1e-15, sought=4)
    assert settled.iterations < whole.iterations
    equations = normal_equations(problem, whole.values).eliminated(0.0)
    sigmas = equations.sigmas(4)
    np.testing.assert_allclose(sigmas, np.sqrt(np.diag(np.linalg.inv(equations.matrix)))[:4], rtol=1e-6)
    ends = [vector_of(found.values.cameras[0])[:4] for found in (settled, whole)]
    assert (np.abs(ends[0] - ends[1]) < 2 * SETTLED * sigmas).all()
