"""Maps between rotation vectors and rotations, and their Jacobians, compiled for the loops that need them.

Vectors and matrices are tuples, as in `ispom.numerics.vectors`. `ispom.geometry` has the public maps, for arrays of any
shape. Source: Barfoot, State Estimation for Robotics, 7.1.
"""

from __future__ import annotations

import numpy as np

from ispom.kernels import kernel, part
from ispom.numerics.vectors import dot, matrix, scaled, store

NEAR_HALF_TURN = -0.99
"""Cosine of the angle (172 degrees) above which the axis is computed from the symmetric part."""


@part
def exp3(v):
    """Returns the rotation of a rotation vector."""
    a, b = rodrigues(dot(v, v))
    return _combination(v, a, b)


@part
def rodrigues(angle2):
    """Returns a and b of exp(v) = I + a [v]x + b [v]x^2, from the squared length of v."""
    if angle2 < 1e-8:
        return 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    angle = np.sqrt(angle2)
    return np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2


@part
def log3(m):
    """Returns the rotation vector, of length 0..pi, of a rotation."""
    twice = _twice_sine_axis(m)
    sine, cosine = 0.5 * np.sqrt(dot(twice, twice)), 0.5 * (m[0][0] + m[1][1] + m[2][2] - 1.0)
    if cosine < NEAR_HALF_TURN:
        return _log_of_half_turn(m, np.arctan2(sine, cosine), cosine)
    return scaled(0.5 if sine < 1e-9 else 0.5 * np.arctan2(sine, cosine) / sine, twice)


@part
def _twice_sine_axis(m):
    return m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]


@part
def _log_of_half_turn(m, angle, cosine):
    """Returns the rotation vector near a half turn. There the difference from the transpose vanishes, and the sum with
    it is about a a', with the axis a."""
    k = 1 if m[1][1] > m[0][0] else 0
    k = 2 if m[2][2] > m[k][k] else k
    axis = _column_of_sum(m, 0, k, cosine), _column_of_sum(m, 1, k, cosine), _column_of_sum(m, 2, k, cosine)
    axis = scaled(angle / np.sqrt(dot(axis, axis)), axis)
    return scaled(-1.0 if dot(axis, _twice_sine_axis(m)) < 0.0 else 1.0, axis)


@part
def _column_of_sum(m, i, k, cosine):
    return m[k][k] - cosine if i == k else 0.5 * (m[i][k] + m[k][i])


@kernel()
def logs(rotations):
    """Returns the rotation vectors (N, 3) of rotations (N, 3, 3)."""
    out = np.empty((len(rotations), 3))
    for n in range(len(rotations)):
        store(out, n, log3(matrix(rotations, n)))
    return out


@part
def right_jacobian(v):
    """Returns J with exp(v + d) = exp(v) exp(J d) for small d."""
    angle2 = dot(v, v)
    if angle2 < 1e-8:
        return _combination(v, -0.5 + angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0)
    angle = np.sqrt(angle2)
    return _combination(v, -(1.0 - np.cos(angle)) / angle2, (angle - np.sin(angle)) / (angle2 * angle))


@part
def inverse_right_jacobian(v):
    """Returns the inverse of `right_jacobian`, for angles below 2 pi."""
    angle2 = dot(v, v)
    if angle2 < 1e-6:
        return _combination(v, 0.5, 1.0 / 12.0 + angle2 / 720.0)
    half = 0.5 * np.sqrt(angle2)
    return _combination(v, 0.5, (1.0 - half * np.cos(half) / np.sin(half)) / angle2)


@part
def _combination(v, a, b):
    """Returns I + a [v]x + b [v]x^2."""
    x, y, z = v
    return (
        (1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y),
        (b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x),
        (b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)),
    )
