"""The pose of one camera or a pair against held points, on synthesised truth."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.geometry import Pose
from ispom.solvers.localisation import Policy, fit_pose, in_own_unit, locate

BASELINE, SCALE = 0.5, 0.5 / 700
TRUTH = Pose.from_rotvec(np.array([0.02, -0.05, 0.01]), np.array([0.1, -0.05, -1.1]))


def scene(count: int = 120) -> tuple[np.ndarray, np.ndarray]:
    """Points, and where a pair sees them; one camera sees the first two columns."""
    xyz = np.random.default_rng(0).uniform([-8, -3, 6], [8, 3, 40], (count, 3))
    p = TRUTH.apply(xyz)
    right = (p[:, 0] - BASELINE) / p[:, 2]
    return xyz, np.column_stack([p[:, :2] / p[:, 2:], right])


def error(found: Pose) -> float:
    return float(np.abs((found @ TRUTH.inverse()).log()).max())


def test_exact_points_give_the_pose_of_a_pair() -> None:
    xyz, seen = scene()
    found = fit_pose(xyz, seen, Pose(), SCALE, 5 * SCALE, BASELINE)
    assert found is not None and found.inliers.all() and error(found.camera_from_world) < 1e-7


def test_exact_points_give_the_pose_of_one_camera() -> None:
    xyz, seen = scene()
    found = fit_pose(xyz, seen[:, :2], Pose(), SCALE, 5 * SCALE)
    assert found is not None and found.distances.max() < 1e-9 and error(found.camera_from_world) < 1e-7


def test_a_pair_without_right_places_is_one_camera() -> None:
    xyz, seen = scene()
    seen[:, 2] = np.nan
    seen += 0.1 * SCALE * np.random.default_rng(1).standard_normal(seen.shape)
    pair, one = fit_pose(xyz, seen, TRUTH, SCALE, 1.0, BASELINE), fit_pose(xyz, seen[:, :2], TRUTH, SCALE, 1.0)
    assert pair is not None and one is not None
    assert np.array_equal(pair.camera_from_world.matrix, one.camera_from_world.matrix)


def test_gross_errors_and_missing_right_places_are_survived() -> None:
    xyz, seen = scene()
    seen[::5] += 0.05
    seen[::3, 2] = np.nan
    guess = Pose.exp(np.array([0.05, 0.02, 0.1, 0.002, 0.005, -0.003])) @ TRUTH
    found = fit_pose(xyz, seen, guess, SCALE, 5 * SCALE, BASELINE)
    assert found is not None and found.inliers.tolist() == [i % 5 != 0 for i in range(len(xyz))]
    assert error(found.camera_from_world) < 1e-4


def test_gross_errors_of_one_camera_lose_their_weight() -> None:
    xyz, seen = scene()
    seen[::4] += 0.2
    guess = Pose.exp(np.array([0.05, 0.02, 0.1, 0.002, 0.02, -0.003])) @ TRUTH
    found = fit_pose(xyz, seen[:, :2], guess, SCALE, 3 * SCALE)
    assert found is not None and found.inliers.tolist() == [i % 4 != 0 for i in range(len(xyz))]
    assert error(found.camera_from_world) < 1e-3


def test_a_poor_guess_ends_where_the_points_agree() -> None:
    """Seen on sim:tiny: a loss too narrow for its guess left the pose 0.3 m away, each point a pixel or two off."""
    xyz, seen = scene()
    seen = seen + 0.1 * SCALE * np.random.default_rng(1).standard_normal(seen.shape)
    guess = Pose.exp(np.array([0.02, 0.03, -0.5, 0.002, 0.001, 0.002])) @ TRUTH
    found = fit_pose(xyz, seen, guess, SCALE, 5 * SCALE, BASELINE)
    assert found is not None and found.inliers.all() and error(found.camera_from_world) < 0.003


def test_from_a_good_guess_the_lesser_part_of_the_points_suffices() -> None:
    """Seen where a map was found again by three-point samples: two thirds of the tracks were wrong."""
    xyz, seen = scene()
    seen[40:] += np.random.default_rng(2).uniform(-0.3, 0.3, (80, 3))
    guess = Pose.exp(np.array([0.01, 0.0, 0.02, 0.0, 0.001, 0.0])) @ TRUTH
    found = fit_pose(xyz, seen[:, :2], guess, SCALE, 3 * SCALE, widest=3 * SCALE)
    assert found is not None and found.inliers[:40].all() and error(found.camera_from_world) < 1e-3


def test_a_prior_holds_what_few_points_leave_open() -> None:
    xyz, seen = scene()
    guess = Pose(translation=np.array([0.1, -0.05, -1.1]))
    held = fit_pose(xyz[:6], seen[:6], guess, SCALE, 1.0, BASELINE, prior=np.eye(6) * 1e12)
    assert held is not None
    np.testing.assert_allclose(held.camera_from_world.matrix, guess.matrix, atol=1e-4)


@pytest.mark.parametrize("images", [2, 3])
def test_the_information_predicts_the_scatter(images: int) -> None:
    """Errors of many noisy runs, weighed with it: 6 degrees of freedom. The loss is wide: least squares."""
    xyz, seen = scene(80)
    rng, sigma, nees = np.random.default_rng(1), 1e-4, []
    for _ in range(60):
        noisy = (seen + rng.normal(0, sigma, seen.shape))[:, :images]
        found = fit_pose(xyz, noisy, TRUTH, 10 * sigma, 20 * sigma, BASELINE)
        assert found is not None
        twist = (found.camera_from_world @ TRUTH.inverse()).log()
        nees.append(twist @ found.information @ twist * 10**2)
    assert 4.5 < np.mean(nees) < 7.5


def test_too_few_points_are_no_pose() -> None:
    xyz, seen = scene()
    assert fit_pose(xyz[:5], seen[:5], TRUTH, SCALE, SCALE, BASELINE) is None
    assert fit_pose(xyz, seen + 1, TRUTH, SCALE, SCALE, BASELINE) is None


@pytest.mark.parametrize("unit", [1e-7, 1.0, 1e4])
@pytest.mark.parametrize("predicted", [True, False])
def test_the_unit_of_the_points_and_their_place_in_the_world_do_not_matter(unit: float, predicted: bool) -> None:
    """Those of a map whose unit has collapsed far from the origin of its world."""
    xyz, seen = scene()
    seen = seen[:, :2].copy()
    seen[::5] += 0.05
    world = Pose.from_rotvec(np.array([0.3, 0.2, -0.4]), np.array([2.0, -9.0, 4.0]))
    truth = Pose(TRUTH.rotation, unit * TRUTH.translation) @ world.inverse()
    turn = 0.01 if predicted else 0.3
    offset = Pose.from_rotvec(np.array([turn, -turn, 0.0]), unit * np.array([0.2, 0.1, 0.3]))
    policy = Policy(SCALE, 5 * SCALE, 5 * SCALE)
    found = in_own_unit(world.apply(unit * xyz), offset @ truth, lambda near, guess: locate(near, seen, guess, policy))
    assert found is not None and found.inliers.tolist() == [i % 5 != 0 for i in range(len(xyz))]
    left = (found.camera_from_world @ truth.inverse()).log()
    assert np.abs(left[:3]).max() < 1e-4 * unit and np.abs(left[3:]).max() < 1e-5
    there = np.diag(found.information)
    known = fit_pose(xyz, seen, TRUTH, SCALE, 5 * SCALE)
    assert known is not None
    np.testing.assert_allclose(there * np.array([unit] * 3 + [1] * 3) ** 2, np.diag(known.information), rtol=0.05)
