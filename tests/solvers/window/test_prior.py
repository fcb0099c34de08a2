"""The prior of a window: what else shows the corrections, and how they change with time."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

from ispom.geometry import Array
from ispom.solvers.window.prior import POSE, Evidence, PendingScores, Prior, Sandwich, anchored

SIGMA = np.array([0.5, 2.0, 0.0])


def prior() -> Prior:
    """Of one pose and two corrections that are known together, and a third that is held."""
    rng = np.random.default_rng(0)
    root = rng.normal(size=(12, POSE + 2))
    hessian = np.eye(POSE + 3)
    hessian[:-1, :-1] = root.T @ root + np.diag([0.0] * POSE + [4.0, 0.25])
    gradient = np.append(rng.normal(size=POSE + 2), 0.0)
    return Prior(np.eye(3)[None], np.zeros((1, 3)), np.array([0.3, -1.0, 0.0]), hessian, gradient)


def mean(of: Prior) -> Array:
    """(6 + E,) of the pose's twist, and of the corrections."""
    return np.append(np.zeros(POSE), of.extra) - np.linalg.solve(of.hessian, of.gradient)


def test_corrections_change_with_time_as_a_gauss_markov_process() -> None:
    before, kept = prior(), 0.8
    after = before.with_process_noise(kept, SIGMA)
    step = np.diag([*[1.0] * POSE, kept, kept, 1.0])
    came = np.diag([*[0.0] * POSE, *((1 - kept**2) * SIGMA**2)])
    np.testing.assert_allclose(mean(after), step @ mean(before), atol=1e-9)
    wanted = step @ np.linalg.inv(before.hessian) @ step + came
    np.testing.assert_allclose(np.linalg.inv(after.hessian), wanted, atol=1e-9)


def test_what_is_never_seen_keeps_its_deviation_however_long() -> None:
    found = anchored(np.eye(3), np.zeros(3), SIGMA)
    for _ in range(1000):
        found = found.with_process_noise(0.99, SIGMA)
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(found.hessian))[POSE:-1]), SIGMA[:-1], rtol=1e-9)


def test_in_no_time_nothing_changes() -> None:
    assert prior().with_process_noise(1.0, SIGMA).hessian is not None
    np.testing.assert_array_equal(prior().with_process_noise(1.0, SIGMA).hessian, prior().hessian)


def test_in_another_unit_of_the_cost_it_says_the_same() -> None:
    """With a sandwich of its own, with what lasting tracks said, and with none, where its Hessian stands for both."""
    rng, before, shift = np.random.default_rng(4), prior(), np.linspace(-1, 1, POSE + 3)
    root, slopes = rng.normal(size=(POSE + 3, 20)), rng.normal(size=(4, POSE + 3))
    own = Sandwich(before.hessian, root @ root.T, PendingScores(np.arange(4), slopes))
    for kept in (None, own):
        one = replace(before, sandwich=kept, constant=2.0)
        other = one.times(9.0)
        assert other.cost(shift) == pytest.approx(9 * one.cost(shift))
        np.testing.assert_allclose(mean(other), mean(one))
        np.testing.assert_allclose(covered(other), covered(one))


def covered(of: Prior) -> Array:
    """(D, D) covariance by its sandwich."""
    kept = of.sandwich or Sandwich(of.hessian, of.hessian)
    said = np.zeros_like(of.hessian) if kept.pending is None else kept.pending.scores.T @ kept.pending.scores
    return np.linalg.inv(kept.curvature) @ (kept.scatter + said) @ np.linalg.inv(kept.curvature)


def test_evidence_is_a_least_squares_problem_more() -> None:
    rng, before = np.random.default_rng(1), prior()
    design, seen = rng.normal(size=(5, 3)), rng.normal(size=5)
    after = before.with_evidence(Evidence(design, seen, np.zeros(5), np.arange(5)))
    for _ in range(3):
        shift = rng.normal(size=POSE + 3)
        error = design @ (before.extra + shift[POSE:]) - seen
        np.testing.assert_allclose(after.cost(shift), before.cost(shift) + 0.5 * error @ error)


def test_what_tracks_said_goes_along_as_their_squares_do() -> None:
    """Through time, and where unknowns are eliminated."""
    rng, before = np.random.default_rng(2), prior()
    slopes = rng.normal(size=(4, POSE + 3)) * (SIGMA > 0)[[0] * POSE + [0, 1, 2]]
    squares = slopes.T @ slopes
    found = []
    for sandwich in (
        Sandwich(before.hessian, squares),
        Sandwich(before.hessian, 0 * squares, PendingScores(np.arange(4), slopes)),
        Sandwich(before.hessian, 0 * squares),
    ):
        aged = replace(before, sandwich=sandwich).with_process_noise(0.8, SIGMA).sandwich
        assert aged is not None
        gone = np.arange(POSE + 3) < 2
        left = aged.without(rng.normal(size=(POSE + 1, 2)) * 0 + 0.3, gone)
        said = np.zeros((0, POSE + 1)) if left.pending is None else left.pending.scores
        found.append(left.scatter + said.T @ said)
    np.testing.assert_allclose(found[0], found[1], atol=1e-9)
    assert np.abs(found[1] - found[2]).max() > 0.1


def test_a_track_says_the_same_twice_and_it_counts_twice_in_one() -> None:
    rng, first = np.random.default_rng(3), anchored(np.eye(3), np.zeros(3), SIGMA)
    design, left = rng.normal(size=(3, 3)), np.array([0.5, -0.2, 0.1])
    once = Evidence(design, np.zeros(3), left, np.array([2, 5, 9]))
    other = Evidence(design[:2], np.zeros(2), left[:2], np.array([5, 7]))
    found = first.with_evidence(once).with_evidence(other).sandwich
    assert found is not None and found.pending is not None
    np.testing.assert_array_equal(found.pending.ids, [2, 5, 7, 9])
    said = left[:, None] * design
    np.testing.assert_allclose(found.pending.scores[:, POSE:], [said[0], said[1] + said[0], said[1], said[2]])
    weights = 1 - 2 * np.concatenate([left, left[:2]]) ** 2
    every = np.vstack([design, design[:2]])
    wanted = anchored(np.eye(3), np.zeros(3), SIGMA).hessian[POSE:, POSE:] + every.T @ (every * weights[:, None])
    np.testing.assert_allclose(found.curvature[POSE:, POSE:], wanted)


def test_a_step_to_no_number_costs_more_than_any_other_and_is_not_warned_of() -> None:
    with warnings.catch_warnings(), np.errstate(all="raise"):
        warnings.simplefilter("error")
        for wrong in (np.nan, np.inf, -np.inf):
            assert prior().cost(np.append(np.zeros(POSE + 2), wrong)) == np.inf


def test_what_a_track_has_said_by_then_stays_in_the_states_before() -> None:
    before = PendingScores(np.array([2, 5]), np.array([[1.0, 2.0], [3.0, 4.0]]))
    after = before.and_of(np.array([5, 7]), np.array([[10.0, 20.0], [30.0, 40.0]]))
    np.testing.assert_array_equal(before.scores, [[1.0, 2.0], [3.0, 4.0]])
    np.testing.assert_array_equal(after.ids, [2, 5, 7])
    np.testing.assert_array_equal(after.scores, [[1.0, 2.0], [13.0, 24.0], [30.0, 40.0]])
