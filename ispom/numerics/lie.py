"""Maps between rotation vectors and rotations, and their Jacobians, compiled for the loops that need them.

`ispom.geometry` has them for arrays of any shape, and for people. Barfoot, State Estimation for Robotics, 7.1.
"""

from __future__ import annotations

import numpy as np

from ispom.kernels import kernel, part

NEAR_HALF_TURN = -0.99
"""Cosine of an angle from which on the axis is found otherwise."""


@kernel()
def exp3(v):
    """Rotation (3, 3) of a rotation vector (3,)."""
    angle2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    a, b = rodrigues(angle2)
    return _combination(v, 1.0, a, b)


@part
def rodrigues(angle2):
    """a and b of exp(v) = I + a [v]x + b [v]x^2, of the square of the length of v."""
    if angle2 < 1e-8:
        return 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    angle = np.sqrt(angle2)
    return np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2


@kernel()
def log3(r):
    """Rotation vector (3,), of length 0..pi, of a rotation (3, 3)."""
    x, y, z = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    sine = 0.5 * np.sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (r[0, 0] + r[1, 1] + r[2, 2] - 1.0)
    if cosine < NEAR_HALF_TURN:
        return _log_of_half_turn(r, sine, cosine)
    factor = 0.5 if sine < 1e-9 else 0.5 * np.arctan2(sine, cosine) / sine
    return np.array([factor * x, factor * y, factor * z])


@kernel()
def _log_of_half_turn(r, sine, cosine):
    """Near a half turn the difference from the transpose vanishes, and the sum with it shows the axis a: ~ a a'."""
    k = 0
    for i in range(1, 3):
        if r[i, i] > r[k, k]:
            k = i
    axis = np.empty(3)
    for i in range(3):
        axis[i] = r[k, k] - cosine if i == k else 0.5 * (r[i, k] + r[k, i])
    axis *= np.arctan2(sine, cosine) / np.sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2])
    along = axis[0] * (r[2, 1] - r[1, 2]) + axis[1] * (r[0, 2] - r[2, 0]) + axis[2] * (r[1, 0] - r[0, 1])
    return -axis if along < 0.0 else axis


@kernel()
def logs(rotations):
    """Rotation vectors (N, 3) of rotations (N, 3, 3)."""
    out = np.empty((len(rotations), 3))
    for n in range(len(rotations)):
        out[n] = log3(rotations[n])
    return out


@kernel()
def right_jacobian(v):
    """(3, 3) J with exp(v + d) = exp(v) exp(J d) for small d."""
    angle2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    if angle2 < 1e-8:
        return _combination(v, 1.0, -0.5 + angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0)
    angle = np.sqrt(angle2)
    return _combination(v, 1.0, -(1.0 - np.cos(angle)) / angle2, (angle - np.sin(angle)) / (angle2 * angle))


@kernel()
def inverse_right_jacobian(v):
    """The inverse of `right_jacobian`, for angles below 2 pi."""
    angle2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    if angle2 < 1e-6:
        return _combination(v, 1.0, 0.5, 1.0 / 12.0 + angle2 / 720.0)
    angle = np.sqrt(angle2)
    half = 0.5 * angle
    return _combination(v, 1.0, 0.5, (1.0 - half * np.cos(half) / np.sin(half)) / angle2)


@kernel()
def _combination(v, one, a, b):
    """one I + a [v]x + b [v]x^2."""
    x, y, z = v[0], v[1], v[2]
    out = np.empty((3, 3))
    out[0, 0], out[1, 1], out[2, 2] = one - b * (y * y + z * z), one - b * (x * x + z * z), one - b * (x * x + y * y)
    out[0, 1], out[1, 0] = b * x * y - a * z, b * x * y + a * z
    out[0, 2], out[2, 0] = b * x * z + a * y, b * x * z - a * y
    out[1, 2], out[2, 1] = b * y * z - a * x, b * y * z + a * x
    return out
