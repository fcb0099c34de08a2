"""A spline through two pairs and the video between them: how the poses of the two cameras lie to each other."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from ispom.geometry import Array, Pose
from ispom.solvers.spline.accelerations import accelerations, solve_with_accelerations
from ispom.solvers.spline.continuous import Solution, solve
from ispom.solvers.spline.fit import fitted
from ispom.solvers.spline.problem import PosePrior, SplineProblem
from tests.nees import DOF, band
from tests.solvers.made_flight import Flight, made_flight, problem_of

FRAME_S = 1 / 30
SEEDS = range(6)


@cache
def short_flight(seed: int) -> tuple[Flight, SplineProblem]:
    """Two pairs and ten video frames between them; noise of 0.1 px, weighed as such."""
    flight = made_flight(1 / 3, 160, seed=seed)
    problem = problem_of(flight, 0.1, seed=seed)
    o = problem.observations
    return flight, replace(problem, observations=replace(o, inverse_sigma=3 * o.inverse_sigma))


def with_knots(problem: SplineProblem, frames: int) -> SplineProblem:
    """So many frames apart, none beyond those that the exposures take."""
    guess = problem.sampled()
    return replace(problem, spline=fitted(problem.times_s, guess.rotations, guess.positions, frames * FRAME_S))


def nees(flight: Flight, found: Solution) -> float:
    """Of a pose in the middle of the video, relative to the last pair."""
    pair, frame = len(flight.times_s) - 1, len(flight.times_s) // 2
    assert not flight.video[pair] and flight.video[frame]
    at = [Pose(found.sampled.rotations[e], found.sampled.positions[e]) for e in (pair, frame)]
    way, true = at[0].inverse() @ at[1], flight.truth(pair).inverse() @ flight.truth(frame)
    error = (way.inverse() @ true).log()
    covariance = found.pose_covariance(frame, found.parameter_covariance(PosePrior(pair, at[0], np.eye(6) * 1e10)))
    return float(error @ np.linalg.solve(covariance, error))


def true_accelerations(flight: Flight) -> Array:
    """(2,) root mean square [rad/s^2, m/s^2] of a component, by differences of the true way from frame to frame."""
    poses = [flight.path.pose_at(round(1e9 * (flight.start_s + t))) for t in np.arange(0, 1 / 3, FRAME_S)]
    turns = np.array([(a.inverse() @ b).rotvec for a, b in pairwise(poses)])
    second = np.diff(turns, axis=0), np.diff([p.translation for p in poses], 2, axis=0)
    return np.array([np.sqrt((d**2).mean()) for d in second]) / FRAME_S**2


def test_video_and_pairs_lie_to_each_other_as_surely_as_is_said() -> None:
    flights = [short_flight(seed) for seed in SEEDS]
    low, high = band(DOF, len(flights))
    coarse = [nees(flight, solve(with_knots(problem, 2), 8)) for flight, problem in flights]
    assert np.mean(coarse) > 1.5 * high  # no covariance knows what these knots cannot follow
    dense = [nees(flight, solve_with_accelerations(with_knots(problem, 1), 8)) for flight, problem in flights]
    assert low < np.mean(dense) < high


@pytest.mark.parametrize("seed", SEEDS)
def test_accelerations_are_those_of_the_flight(seed: int) -> None:
    flight, problem = short_flight(seed)
    found = accelerations(solve_with_accelerations(with_knots(problem, 1), 8))
    np.testing.assert_allclose(np.log(found / true_accelerations(flight)), 0, atol=np.log(1.6))


def test_where_images_determine_none_the_usual_belief_stays() -> None:
    _, problem = short_flight(0)
    o = problem.observations
    blind = replace(with_knots(problem, 1), observations=replace(o, inverse_sigma=1e-6 * o.inverse_sigma))
    assert accelerations(solve(blind, 3)) == problem.smoothness
