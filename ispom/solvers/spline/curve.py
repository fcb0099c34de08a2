"""Uniform cubic B-splines of poses: rotations cumulative on SO(3), positions in R3; values, rates, analytic Jacobians.

Sommer et al. 2020, "Efficient derivative computation for cumulative B-splines on Lie groups". A rotation changes on its
right, R exp(delta), with delta in the moving frame [rad]; a position changes by addition, in the world.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.kernels import kernel
from ispom.numerics.lie import exp3, inverse_right_jacobian, log3, right_jacobian

ORDER = 4
"""Knots that shape the spline at any one time."""


@dataclass(frozen=True, eq=False)
class Spline:
    """world_from_rig over time: segment i, from start_s + i spacing_s on, is shaped by knots i to i + 3."""

    start_s: float
    spacing_s: float
    rotations: Array
    """(K, 3, 3), K >= 4."""
    positions: Array
    """(K, 3) [m]."""

    def __len__(self) -> int:
        return len(self.rotations)

    @property
    def knot_times_s(self) -> Array:
        """(K,) where each knot counts most."""
        return self.start_s + self.spacing_s * (np.arange(len(self)) - 1)

    def at(self, times_s: Array) -> Sampled:
        """Poses at times (E,) [s]; beyond either end, the outermost segment goes on."""
        times_s = np.ascontiguousarray(times_s, float)
        return Sampled(*_sample(self.start_s, self.spacing_s, self.rotations, self.positions, times_s))

    def moved(self, step: Array) -> Spline:
        """With every knot changed by step (6 K,): its rotation [rad], then its position [m]."""
        rotations, positions = _moved(self.rotations, self.positions, np.ascontiguousarray(step, float))
        return Spline(self.start_s, self.spacing_s, rotations, positions)


@dataclass(frozen=True, eq=False)
class Sampled:
    """A spline at times (E,)."""

    rotations: Array
    """(E, 3, 3) world_from_rig."""
    positions: Array
    """(E, 3) [m]."""
    first: NDArray[np.int64]
    """(E,) the first of the four knots that count."""
    rotation_jacobians: Array
    """(E, 4, 3, 3): how the rotation turns, in the moving frame, with that of each knot."""
    weights: Array
    """(E, 4): how the position changes with that of each knot."""
    rates: Array
    """(E, 6): angular velocity in the moving frame [rad/s], velocity in the world [m/s]."""

    def jacobian(self, e: int, knots: int) -> Array:
        """(6, 6 knots) of pose e (rotation in the moving frame, position in the world) by all knots."""
        out = np.zeros((6, 6 * knots))
        for k in range(ORDER):
            column = 6 * (int(self.first[e]) + k)
            out[:3, column : column + 3] = self.rotation_jacobians[e, k]
            out[3:, column + 3 : column + 6] = self.weights[e, k] * np.eye(3)
        return out


@kernel()
def _sample(start, spacing, rotations, positions, times):
    n, last = len(times), len(rotations) - 4
    r, p, first = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty(n, np.int64)
    jacobians, weights, rates = np.empty((n, 4, 3, 3)), np.empty((n, 4)), np.empty((n, 6))
    differences = np.empty((len(rotations), 3))
    for k in range(1, len(rotations)):
        differences[k] = log3(rotations[k - 1].T @ rotations[k])
    for e in range(n):
        s = (times[e] - start) / spacing
        i = min(max(int(np.floor(s)), 0), last)
        u = s - i
        l1, l2, l3 = (5 + 3 * u - 3 * u * u + u**3) / 6, (1 + 3 * u + 3 * u * u - 2 * u**3) / 6, u**3 / 6
        v1, v2, v3 = (1 - u) ** 2 / 2 / spacing, (1 + 2 * u - 2 * u * u) / 2 / spacing, u * u / 2 / spacing
        d1, d2, d3 = differences[i + 1], differences[i + 2], differences[i + 3]
        a1, a2, a3 = exp3(l1 * d1), exp3(l2 * d2), exp3(l3 * d3)
        a23 = a2 @ a3
        a123 = a1 @ a23
        r[e] = rotations[i] @ a123
        j1 = a23.T @ (l1 * right_jacobian(l1 * d1))
        j2 = a3.T @ (l2 * right_jacobian(l2 * d2))
        j3 = l3 * right_jacobian(l3 * d3)
        i1, i2, i3 = inverse_right_jacobian(d1), inverse_right_jacobian(d2), inverse_right_jacobian(d3)
        jacobians[e, 0] = a123.T - j1 @ i1.T
        jacobians[e, 1] = j1 @ i1 - j2 @ i2.T
        jacobians[e, 2] = j2 @ i2 - j3 @ i3.T
        jacobians[e, 3] = j3 @ i3
        weights[e, 0], weights[e, 1], weights[e, 2], weights[e, 3] = 1 - l1, l1 - l2, l2 - l3, l3
        p[e] = 0.0
        for k in range(4):
            p[e] += weights[e, k] * positions[i + k]
        rates[e, :3] = a23.T @ (v1 * d1) + a3.T @ (v2 * d2) + v3 * d3
        rates[e, 3:] = -v1 * positions[i] + (v1 - v2) * positions[i + 1] + (v2 - v3) * positions[i + 2]
        rates[e, 3:] += v3 * positions[i + 3]
        first[e] = i
    return r, p, first, jacobians, weights, rates


@kernel()
def _moved(rotations, positions, step):
    r, p = np.empty_like(rotations), np.empty_like(positions)
    for k in range(len(rotations)):
        r[k] = rotations[k] @ exp3(step[6 * k : 6 * k + 3])
        p[k] = positions[k] + step[6 * k + 3 : 6 * k + 6]
    return r, p


@kernel()
def add_smoothness(rotations, positions, spacing, sigma_rad_s2, sigma_m_s2, hessian, right):
    """Adds to the normal equations that accelerations are about zero; returns the cost.

    A weak belief: it only decides where no image does. The knots' second difference is a cubic B-spline's acceleration.
    """
    cost = 0.0
    wr, wp = 1.0 / (sigma_rad_s2 * spacing**2) ** 2, 1.0 / (sigma_m_s2 * spacing**2) ** 2
    j = np.zeros((3, 9))
    second = np.array([1.0, -2.0, 1.0])
    for k in range(1, len(rotations) - 1):
        a, b = log3(rotations[k - 1].T @ rotations[k]), log3(rotations[k].T @ rotations[k + 1])
        ia, ib = inverse_right_jacobian(a), inverse_right_jacobian(b)
        j[:, 0:3], j[:, 3:6], j[:, 6:9] = ia.T, -ia - ib.T, ib
        r = b - a
        q = positions[k - 1] - 2 * positions[k] + positions[k + 1]
        cost += 0.5 * (wr * (r @ r) + wp * (q @ q))
        jj, jr = wr * (j.T @ j), wr * (j.T @ r)
        for m in range(3):
            row = 6 * (k - 1 + m)
            for x in range(3):
                right[row + x] -= jr[3 * m + x]
                right[row + 3 + x] -= wp * second[m] * q[x]
            for n in range(3):
                column = 6 * (k - 1 + n)
                for x in range(3):
                    hessian[row + 3 + x, column + 3 + x] += wp * second[m] * second[n]
                    for y in range(3):
                        hessian[row + x, column + y] += jj[3 * m + x, 3 * n + y]
    return cost
