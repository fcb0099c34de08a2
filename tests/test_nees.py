"""NEES on made errors: right covariances lie in the band, too small and too large ones do not."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.geometry import Pose
from ispom.types import Status, Step, Trajectory
from tests.nees import PARTS, Consistency, Errors, band, consistency, errors

RUNS, TIMES = 20, 60


def made(seed: int, claimed: float = 1.0) -> Errors:
    """Errors drawn from a covariance that grows, of which the estimator claims `claimed` times as much."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(6, 6)) * ([[0.01]] * 3 + [[0.001]] * 3)
    covariances = np.arange(1, TIMES + 1)[:, None, None] * (root @ root.T + 1e-8 * np.eye(6))
    twists = np.stack([np.linalg.cholesky(c) @ rng.normal(size=6) for c in covariances])
    return Errors(np.arange(TIMES) * 100, twists, claimed * covariances)


def found(claimed: float, part: str = "pose") -> Consistency:
    result = consistency([made(seed, claimed) for seed in range(RUNS)], PARTS[part])
    assert result is not None
    return result


@pytest.mark.parametrize("part", PARTS)
def test_right_covariances_lie_in_the_band(part: str) -> None:
    result = found(1.0, part)
    assert result.inside > 0.85 and result.average == pytest.approx(result.dof, rel=0.1)
    assert result.sigma_factor == pytest.approx(1, rel=0.05) and result.runs == RUNS


def test_too_small_and_too_large_ones_do_not() -> None:
    small, large = found(0.25), found(4.0)
    assert small.inside == 0 and small.above == 1 and small.sigma_factor == pytest.approx(2, rel=0.05)
    assert (small.below, large.below) == (0, 1) and large.longest_above_s == 0
    assert small.longest_above_s == pytest.approx((TIMES - 1) * 1e-7)
    assert large.inside == 0 and large.above == 0 and large.sigma_factor == pytest.approx(0.5, rel=0.05)


def test_the_longest_stretch_above_ends_where_the_next_time_is_not() -> None:
    claims = np.ones(10)
    claims[[1, 4, 5]] = 1e-3
    run = Errors(np.arange(10) * 10**9, np.ones((10, 6)), claims[:, None, None] * np.eye(6))
    result = consistency([run, run])
    assert result is not None and result.above == pytest.approx(0.3) and result.longest_above_s == 2


def test_the_band_is_bar_shaloms() -> None:
    low, high = band(6, 50)
    assert (low, high) == pytest.approx((5.08, 7.0), abs=0.02)  # chi-square 254 .. 350 with 300 degrees of freedom
    assert band(2, 1, 0.95) == pytest.approx((0.0506, 7.378), abs=0.001)


def test_errors_are_relative_to_the_first_pose_and_on_the_right() -> None:
    rng = np.random.default_rng(3)
    true = [Pose.exp(rng.normal(size=6)) for _ in range(4)]
    world, twists = Pose.exp(rng.normal(size=6)), rng.normal(0, 0.01, (4, 6))
    twists[0] = 0
    given = [world @ pose @ Pose.exp(twist).inverse() for pose, twist in zip(true, twists, strict=True)]
    steps = [
        Step(
            i, Status.TRACKING, "rig", pose, covariance=None if i == 2 else np.diag(np.arange(1.0, 7)), method="stereo"
        )
        for i, pose in enumerate(given)
    ]
    steps.insert(2, Step(99, Status.LOST, method="stereo"))
    result = errors(steps, Trajectory.of(list(enumerate(true))))
    np.testing.assert_array_equal(result.times_ns, [1, 3])
    np.testing.assert_allclose(result.twists, twists[[1, 3]], atol=1e-12)
    np.testing.assert_allclose(result.nees(), (twists[[1, 3]] ** 2 / np.arange(1, 7)).sum(1), rtol=1e-9)


def test_poses_in_an_own_unit_are_compared_in_that_of_their_first_baseline() -> None:
    rng = np.random.default_rng(4)
    true = [Pose.exp(np.append(rng.normal(size=3), 0.3 * rng.normal(size=3))) for _ in range(5)]
    world, twists = Pose.exp(rng.normal(size=6)), rng.normal(0, 0.01, (5, 6))
    twists[:3] = 0
    moved = [(true[0].inverse() @ pose).scaled(0.3) for pose in true]
    given = [world @ pose @ Pose.exp(twist).inverse() for pose, twist in zip(moved, twists, strict=True)]
    steps = [
        Step(
            i,
            Status.TRACKING,
            "video",
            pose,
            covariance=None if i < 2 else np.diag(np.arange(1.0, 7)),
            method="monocular",
        )
        for i, pose in enumerate(given)
    ]
    result = errors(steps, Trajectory.of(list(enumerate(true))), own_unit=True)
    np.testing.assert_array_equal(result.times_ns, [3, 4])
    np.testing.assert_allclose(result.twists, twists[3:], atol=1e-12)


def test_runs_without_common_times_say_nothing() -> None:
    late = made(1)
    assert consistency([]) is None
    assert consistency([made(0), Errors(late.times_ns + 7, late.twists, late.covariances)]) is None
