"""The Jacobian of the reprojection: against differences, and the compiled products against the arrays."""

from __future__ import annotations

import numba
import numpy as np

from ispom.geometry import Array, Pose
from ispom.numerics.reprojection import (
    add_by_twist,
    gradient_by_point,
    hessian_by_point,
    reprojected,
    subtract_by_twists,
)
from ispom.numerics.vectors import symmetric, vector

BASELINE = 0.3


@numba.njit
def products(xyz: Array, errors: Array, baseline: float, hessian: Array, gradient: Array) -> None:
    """What the solvers sum up of points (N, 3) with errors (N, 3), all of weight one."""
    for n in range(len(xyz)):
        q = vector(xyz, n)
        iz = 1.0 / q[2]
        x, y, right = q[0] * iz, q[1] * iz, (q[0] - baseline) * iz
        by_q = gradient_by_point(x, y, right, iz, errors[n, 0], errors[n, 1], errors[n, 2])
        add_by_twist(gradient, 0, q, by_q)
        k = hessian_by_point(x, y, right, iz * iz, 1.0, 0.25, 2.0, 3.0)
        subtract_by_twists(hessian, 0, 0, q, symmetric(k), q)


def points() -> Array:
    return np.random.default_rng(0).uniform([-3, -2, 2], [3, 2, 9], (20, 3))


def differences(image: object, eps: float = 1e-6) -> Array:
    """(N, D, 6) of image coordinates by a left twist, by central differences."""
    twists = [s * eps * np.eye(6)[k] for k in range(6) for s in (1, -1)]
    seen = np.stack([image(Pose.exp(t).apply(points())) for t in twists])  # type: ignore[operator]
    return np.moveaxis((seen[::2] - seen[1::2]) / (2 * eps), 0, 2)


def test_the_jacobian_is_that_of_central_differences() -> None:
    uv, by_point, by_twist = reprojected(points())
    np.testing.assert_allclose(uv, points()[:, :2] / points()[:, 2:])
    np.testing.assert_allclose(by_twist, differences(lambda p: reprojected(p)[0]), atol=1e-8)
    np.testing.assert_array_equal(by_point, by_twist[:, :, :3])


def test_the_compiled_products_are_those_of_the_arrays() -> None:
    """Both forms of the one Jacobian, with the right image that shares its row of y with none."""
    shifted = points() - (BASELINE, 0, 0)
    _, by_right_point, _ = reprojected(shifted)
    cross = -np.array([[[0, -z, y], [z, 0, -x], [-y, x, 0]] for x, y, z in points()])
    by_right = np.concatenate([by_right_point[:, :1], by_right_point[:, :1] @ cross], axis=2)
    jacobian = np.concatenate([reprojected(points())[2], by_right], axis=1)
    errors = np.random.default_rng(1).standard_normal((20, 3))
    hessian, gradient = np.zeros((1, 1, 6, 6)), np.zeros((1, 6))
    products(points(), errors, BASELINE, hessian, gradient)
    np.testing.assert_allclose(gradient[0], np.einsum("nij,ni->j", jacobian, errors), rtol=1e-12)
    weight = np.array([[1.0, 0.25, 0.0], [0.25, 2.0, 0.0], [0.0, 0.0, 3.0]])
    wanted = np.einsum("nia,ij,njb->ab", jacobian, weight, jacobian)
    np.testing.assert_allclose(-hessian[0, 0], wanted, rtol=1e-12, atol=1e-12)
