"""Section 6.2: the rigid transformation between two clouds, and the rotation between two views."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ispom.geometry import Pose, so3_exp
from ispom.solvers.multiview.rotation import dominant_rotation, median_displacement, rotate
from ispom.solvers.multiview.triangulation import points_from_disparity
from ispom.solvers.rigid import horn, rigid_motion
from ispom.types import Camera

numbers = st.floats(-2, 2)


@given(st.tuples(numbers, numbers, numbers), st.tuples(numbers, numbers, numbers), st.integers(0, 99))
def test_horn_is_exact_and_never_a_reflection(rotvec: tuple, translation: tuple, seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(4, 3))
    rotation = so3_exp(np.array(rotvec))
    found, offset = horn(points, points @ rotation.T + translation)
    np.testing.assert_allclose(found, rotation, atol=1e-6)
    np.testing.assert_allclose(offset, translation, atol=1e-6)
    flat = points * (1, 1, 0)
    assert np.linalg.det(horn(flat, flat * (1, -1, 1))[0]) > 0.99


def test_rigid_motion_with_outliers_and_distance_dependent_noise() -> None:
    rng = np.random.default_rng(0)
    source = rng.uniform([-5, -3, 4], [5, 3, 25], (300, 3))
    truth = Pose.from_rotvec(np.array([0.01, 0.08, -0.02]), np.array([0.1, -0.05, 0.9]))
    tolerance = 0.004 * source[:, 2] ** 2 + 0.02
    target = truth.apply(source) * (1 + rng.normal(0, 0.1, (300, 1)) * tolerance[:, None] / source[:, 2:])
    target[:100] += rng.normal(0, 4, (100, 3))
    found = rigid_motion(source, target, tolerance)
    assert found is not None and found.inliers[100:].mean() > 0.95 and found.inliers[:100].mean() < 0.1
    error = (found.target_from_source @ truth.inverse()).log()
    assert np.abs(error[:3]).max() < 0.03 and np.abs(error[3:]).max() < 0.002
    again = rigid_motion(source, target, tolerance)
    assert again is not None and np.array_equal(again.target_from_source.matrix, found.target_from_source.matrix)


def test_too_few_points_or_nothing_in_common_gives_none() -> None:
    rng = np.random.default_rng(1)
    assert rigid_motion(np.zeros((5, 3)), np.zeros((5, 3)), np.ones(5)) is None
    assert rigid_motion(rng.normal(size=(40, 3)), 50 * rng.normal(size=(40, 3)), np.full(40, 1e-3)) is None


def test_points_from_disparity() -> None:
    camera = Camera(640, 480, 500, 500, 320, 240)
    xyz = points_from_disparity(camera, 0.4, np.array([[320, 240], [370, 190], [0, 0]]), np.array([20, 10, -1]))
    np.testing.assert_allclose(xyz[:2], [[0, 0, 10], [2, -2, 20]])
    assert np.isnan(xyz[2]).all()


def test_the_dominant_rotation_is_exact_for_a_pure_one_and_leaves_the_parallax_of_near_points() -> None:
    rng = np.random.default_rng(2)
    xyz = rng.uniform([-6, -4, 20], [6, 4, 60], (200, 3))
    xyz[:40] /= 10
    rotation = so3_exp(np.array([0.02, -0.06, 0.1]))
    x1 = xyz[:, :2] / xyz[:, 2:]
    np.testing.assert_allclose(dominant_rotation(x1, rotate(rotation, x1), 1e-3), rotation, atol=1e-9)
    seen = (xyz + np.array([0.02, 0, 0])) @ rotation.T
    x2 = seen[:, :2] / seen[:, 2:]
    found = dominant_rotation(x1, x2, 2e-3)
    assert np.abs(found - rotation).max() < 2e-3
    assert median_displacement(found, x1[:40], x2[:40]) > 3 * median_displacement(found, x1[40:], x2[40:])
