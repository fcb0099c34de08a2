"""The compiled maps against scipy's, up to and at half turns."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ispom.geometry import Array, Pose
from ispom.numerics import lie
from ispom.numerics.lie import logs
from ispom.numerics.twist import twist_of
from ispom.numerics.vectors import matrix, vector


@numba.njit
def _exp3(v):
    return lie.exp3(vector(v, 0))


@numba.njit
def _log3(r):
    return lie.log3(matrix(r, 0))


@numba.njit
def _right_jacobian(v):
    return lie.right_jacobian(vector(v, 0))


@numba.njit
def _inverse_right_jacobian(v):
    return lie.inverse_right_jacobian(vector(v, 0))


def exp3(v: Array) -> Array:
    return np.array(_exp3(v[None]))


def log3(r: Array) -> Array:
    return np.array(_log3(r[None]))


def right_jacobian(v: Array) -> Array:
    return np.array(_right_jacobian(v[None]))


def inverse_right_jacobian(v: Array) -> Array:
    return np.array(_inverse_right_jacobian(v[None]))


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 1e-4, 0.3, 2.0, 3.0, 3.1, np.pi - 1e-5, np.pi - 1e-9])
def test_the_maps_are_each_others_inverse(angle: float) -> None:
    for axis in np.random.default_rng(0).normal(size=(20, 3)):
        vector = angle * axis / np.linalg.norm(axis)
        rotation = exp3(vector)
        np.testing.assert_allclose(rotation, Rotation.from_rotvec(vector).as_matrix(), atol=1e-14)
        np.testing.assert_allclose(log3(rotation), vector, atol=1e-7 if angle > 3.14 else 1e-12)


@pytest.mark.parametrize(
    "axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, -0.8), (0.48, 0.6, 0.64)]
)
def test_a_half_turn_has_an_axis(axis: tuple[float, float, float]) -> None:
    half = 2 * np.outer(axis, axis) - np.eye(3)
    found = log3(half)
    assert np.linalg.norm(found) == pytest.approx(np.pi, abs=1e-9)
    assert abs(found @ np.array(axis)) == pytest.approx(np.pi, abs=1e-9)


def test_many_are_as_each_alone() -> None:
    rotations = Rotation.from_rotvec(np.random.default_rng(1).normal(size=(30, 3))).as_matrix()
    np.testing.assert_array_equal(logs(rotations), np.stack([log3(r) for r in rotations]))
    np.testing.assert_allclose(logs(rotations), Rotation.from_matrix(rotations).as_rotvec(), atol=1e-9)


@pytest.mark.parametrize("angle", [1e-9, 1e-3, 1.0, 3.0])
def test_the_jacobian_is_that_of_the_map(angle: float) -> None:
    vector, step = angle * np.array([0.6, 0.0, 0.8]), 1e-6
    jacobian = right_jacobian(vector)
    for k in range(3):
        further = exp3(vector).T @ exp3(vector + step * np.eye(3)[k])
        np.testing.assert_allclose(log3(further) / step, jacobian[:, k], atol=1e-5)
    np.testing.assert_allclose(inverse_right_jacobian(vector) @ jacobian, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.3, 2.0, 3.0])
def test_the_twist_of_a_pose_is_its_logarithm(angle: float) -> None:
    for axis in np.random.default_rng(1).normal(size=(20, 3)):
        twist = np.concatenate([np.random.default_rng(2).normal(size=3), angle * axis / np.linalg.norm(axis)])
        np.testing.assert_allclose(twist_of(Pose.exp(twist)), twist, atol=1e-12)
        np.testing.assert_allclose(twist_of(Pose.exp(twist).inverse()), -twist, atol=1e-12)
