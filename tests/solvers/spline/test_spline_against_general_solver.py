"""The spline solver against `scipy.optimize.least_squares`: from near the minimum, both end at the same place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from ispom.geometry import Array, so3_log
from ispom.solvers.spline.continuous import solve
from ispom.solvers.spline.problem import SplineProblem
from tests.solvers import oracle
from tests.solvers.made_flight import made_flight, problem_of


def moved(problem: SplineProblem, x: Array) -> SplineProblem:
    knots = 6 * len(problem.spline)
    points = replace(problem.points, values=problem.points.values + x[knots + 7 :].reshape(-1, 3))
    rig = problem.rig.moved(np.where(problem.rig.free, x[knots : knots + 7], 0.0))
    return replace(problem, spline=problem.spline.moved(x[:knots]), rig=rig, points=points)


def residuals(problem: SplineProblem) -> Array:
    """Half the sum of their squares is what the solver minimises."""
    sampled, o, p, spline = problem.sampled(), problem.observations, problem.points, problem.spline
    rotations, positions = problem.rig.arrays()
    ray = np.column_stack([p.values[:, :2], np.ones(len(p))])
    world = np.einsum("mij,mj->mi", p.anchors_r, ray) + p.values[:, 2:] * p.anchors_t
    rho = p.values[o.owner, 2:]
    rig = np.einsum("oji,oj->oi", sampled.rotations[o.exposure], world[o.owner] - rho * sampled.positions[o.exposure])
    q = np.einsum("oji,oj->oi", rotations[o.camera], rig - rho * positions[o.camera])
    image = np.column_stack([q[:, 0], q[:, 1], problem.rig.baseline_m * rho]) / q[:, 2:]
    errors = problem.loss * oracle.cauchy((image - o.seen) * o.inverse_sigma / problem.loss)
    depth = np.sqrt(problem.depth_prior[:, 1]) * (p.values[:, 2] - problem.depth_prior[:, 0])
    turn = np.diff(so3_log(np.swapaxes(spline.rotations[:-1], 1, 2) @ spline.rotations[1:]), axis=0)
    spread = np.array(problem.smoothness) * spline.spacing_s**2
    e, pose = problem.prior.exposure, problem.prior.world_from_rig
    held = np.concatenate([so3_log(pose.rotation.T @ sampled.rotations[e]), sampled.positions[e] - pose.translation])
    known = problem.rig.minus(problem.rig_prior)
    return np.concatenate([
        errors.ravel(), depth, (turn / spread[0]).ravel(), (np.diff(spline.positions, 2, axis=0) / spread[1]).ravel(),
        np.sqrt(np.diag(problem.prior.information)) * held, np.sqrt(np.diag(problem.rig_prior.information)) * known,
    ])  # fmt: skip


def test_a_short_flight_with_noise() -> None:
    """From a few steps on: poses to 20 micrometres and 20 microradians, the costs to one part in a million."""
    start = solve(replace(problem_of(made_flight(0.35, 10), 0.3), loss=50.0), 8, 0.0).problem
    found = solve(start, 200, 1e-15)
    count = 6 * len(start.spline) + 7 + start.points.values.size
    fit = least_squares(lambda x: residuals(moved(start, x)), np.zeros(count), x_scale="jac", ftol=1e-14, max_nfev=20)
    wanted = moved(start, fit.x).sampled()
    assert found.cost_after == pytest.approx(fit.cost, rel=1e-6)
    np.testing.assert_allclose(found.sampled.rotations, wanted.rotations, atol=2e-5)
    np.testing.assert_allclose(found.sampled.positions, wanted.positions, atol=2e-5)
