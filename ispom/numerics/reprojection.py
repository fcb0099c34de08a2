"""Reprojection: the image position of a point in a camera or a rectified pair, and its derivatives by point and pose.

With q the point in the (left) camera, each image coordinate is a = (q_i - shift) / q_z: x, y, and the right camera's x,
which the baseline shifts. Its derivative by q is the row (e_i - a e_z) / q_z. A left twist (rho, phi) of
camera_from_world moves q by rho + phi x q = B (rho, phi), B = [I | -[q]x]: a row g by q is B' g = (g, q x g) by the
twist. All solvers take their Jacobians from here.

There are two implementations, which a test holds equal: `reprojected` for arrays, which the methods of the paper use
(they do not wait for a compilation), and products with the Jacobian for compiled loops, which do not store it.
"""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array
from ispom.kernels import part
from ispom.numerics.vectors import cross, minus, scaled, transposed


def reprojected(xyz_in_camera: Array) -> tuple[Array, Array, Array]:
    """Returns normalised x, y (N, 2) of points (N, 3) before the camera, and their derivatives.

    These are by the point in the camera (N, 2, 3), and by a left twist (rho, phi) of camera_from_world (N, 2, 6).
    """
    z = xyz_in_camera[:, 2]
    u, v = xyz_in_camera[:, 0] / z, xyz_in_camera[:, 1] / z
    by_twist = np.zeros((len(z), 2, 6))
    by_twist[:, 0, 0] = by_twist[:, 1, 1] = 1 / z
    by_twist[:, 0, 2], by_twist[:, 1, 2] = -u / z, -v / z
    by_twist[:, 0, 3], by_twist[:, 0, 4], by_twist[:, 0, 5] = -u * v, 1 + u * u, -v
    by_twist[:, 1, 3], by_twist[:, 1, 4], by_twist[:, 1, 5] = -1 - v * v, u * v, u
    return np.stack([u, v], 1), by_twist[:, :, :3], by_twist


@part
def gradient_by_point(x, y, right, iz, by_x, by_y, by_right):
    """Returns J' (by_x, by_y, by_right): the gradient by q of a function with this gradient by x, y and the right x."""
    return iz * (by_x + by_right), iz * by_y, -iz * (by_x * x + by_y * y + by_right * right)


@part
def hessian_by_point(x, y, right, iz2, xx, xy, yy, rr):
    """Returns J' W J (6 numbers), W = (xx, xy; xy, yy) by x and y and rr by the right x; `iz2` is 1 / q_z^2 times a
    weight."""
    tx, ty = xx * x + xy * y, xy * x + yy * y
    return (
        iz2 * (xx + rr),
        iz2 * xy,
        -iz2 * (tx + rr * right),
        iz2 * yy,
        -iz2 * ty,
        iz2 * (tx * x + ty * y + rr * right * right),
    )


@part
def add_by_twist(out, i, q, g):
    """Adds B' g to out[i] (6,): the gradient by the twist, from the gradient g by q."""
    x, y, z = cross(q, g)
    out[i, 0] += g[0]
    out[i, 1] += g[1]
    out[i, 2] += g[2]
    out[i, 3] += x
    out[i, 4] += y
    out[i, 5] += z


@part
def subtract_by_twists(out, i, j, u, k, q):
    """Subtracts B(u)' K B(q) from out[i, j] (6, 6): K (3, 3) second derivatives by u and q, both moved by twists."""
    x, y, z = transposed(k)
    turned = (
        minus(scaled(q[1], z), scaled(q[2], y)),
        minus(scaled(q[2], x), scaled(q[0], z)),
        minus(scaled(q[0], y), scaled(q[1], x)),
    )
    # With a variable index: the function would be compiled again for each constant.
    for column, by in enumerate((x, y, z, *turned)):
        _subtract_column(out, i, j, column, u, by)


@part
def _subtract_column(out, i, j, column, u, g):
    x, y, z = cross(u, g)
    out[i, j, 0, column] -= g[0]
    out[i, j, 1, column] -= g[1]
    out[i, j, 2, column] -= g[2]
    out[i, j, 3, column] -= x
    out[i, j, 4, column] -= y
    out[i, j, 5, column] -= z
