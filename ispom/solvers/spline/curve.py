"""Uniform cubic B-splines of poses: rotations cumulative on SO(3), positions in R3; values, rates, analytic Jacobians.

Sommer et al. 2020, "Efficient derivative computation for cumulative B-splines on Lie groups". A rotation changes on its
right, R exp(delta), with delta in the moving frame [rad]; a position changes by addition, in the world.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.kernels import kernel, part
from ispom.numerics.lie import exp3, inverse_right_jacobian, log3, right_jacobian
from ispom.numerics.vectors import (
    dot,
    matrix,
    minus,
    plus,
    product,
    scaled,
    store,
    store_matrix,
    times,
    times_transposed,
    transposed,
    vector,
)

ORDER = 4
"""Number of knots that determine a cubic B-spline at any one time, by definition."""


@dataclass(frozen=True, eq=False)
class Spline:
    """world_from_rig over time: knots i to i + 3 determine segment i, which starts at start_s + i spacing_s."""

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
        """Returns the times (K,) at which the weight of each knot is largest."""
        return self.start_s + self.spacing_s * (np.arange(len(self)) - 1)

    def at(self, times_s: Array) -> Sampled:
        """Returns the poses at times (E,) [s]; beyond either end, the outermost segment is extrapolated."""
        times_s = np.ascontiguousarray(times_s, float)
        return Sampled(*_sample(self.start_s, self.spacing_s, self.rotations, self.positions, times_s))

    def moved(self, step: Array) -> Spline:
        """Returns the spline with each knot changed by step (6 K,): its rotation [rad], then its position [m]."""
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
    """(E,) the first of the four knots that determine the pose."""
    rotation_jacobians: Array
    """(E, 4, 3, 3) derivative of the rotation, in the moving frame, by that of each knot."""
    weights: Array
    """(E, 4) derivative of the position by that of each knot."""
    rates: Array
    """(E, 6): angular velocity in the moving frame [rad/s], velocity in the world [m/s]."""

    def jacobian(self, e: int, knots: int) -> Array:
        """Returns the Jacobian (6, 6 knots) of pose e (rotation in the moving frame, position in the world) by all
        knots."""
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
    jacobians, weights, rates = np.zeros((n, 4, 3, 3)), np.empty((n, 4)), np.zeros((n, 6))
    turns, inverses = between_knots(rotations)
    for e in range(n):
        s = (times[e] - start) / spacing
        first[e] = i = min(max(int(np.floor(s)), 0), last)
        u = s - i
        l1, l2, l3 = (5 + 3 * u - 3 * u * u + u**3) / 6, (1 + 3 * u + 3 * u * u - 2 * u**3) / 6, u**3 / 6
        v1, v2, v3 = (1 - u) ** 2 / 2 / spacing, (1 + 2 * u - 2 * u * u) / 2 / spacing, u * u / 2 / spacing
        weights[e, 0], weights[e, 1], weights[e, 2], weights[e, 3] = 1 - l1, l1 - l2, l2 - l3, l3
        _place(p, rates, e, positions, i, weights[e], (-v1, v1 - v2, v2 - v3, v3))
        _turn(r, rates, jacobians[e], e, rotations, i, turns, inverses, (l1, l2, l3), (v1, v2, v3))
    return r, p, first, jacobians, weights, rates


@kernel()
def between_knots(rotations):
    """Returns the rotation vectors (K - 1, 3) from each knot to the next, and the inverses (K - 1, 3, 3) of their
    Jacobians."""
    turns, inverses = np.empty((len(rotations) - 1, 3)), np.empty((len(rotations) - 1, 3, 3))
    for k in range(len(turns)):
        turn = log3(product(transposed(matrix(rotations, k)), matrix(rotations, k + 1)))
        store(turns, k, turn)
        store_matrix(inverses, k, inverse_right_jacobian(turn))
    return turns, inverses


@part
def _place(p, rates, e, positions, i, weights, changes):
    """Fills position and velocity at time e, from knots i to i + 3 with these weights and their rates of change."""
    for x in range(3):
        p[e, x] = 0.0
        for k in range(4):
            p[e, x] += weights[k] * positions[i + k, x]
            rates[e, 3 + x] += changes[k] * positions[i + k, x]


@part
def _turn(r, rates, jacobians, e, rotations, i, turns, inverses, shares, changes):
    """Fills the rotation at time e, its rate, and its Jacobians (4, 3, 3), which are zero before.

    The rotation is that of knot i, times `shares` of the three rotations `turns` between knots; `changes` are the rates
    of these shares.
    """
    after = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)  # the product of all later rotations
    for k in range(2, -1, -1):
        turn = vector(turns, i + k)
        part_of_it, rate = scaled(shares[k], turn), times_transposed(after, scaled(changes[k], turn))
        by_turn = product(transposed(after), right_jacobian(part_of_it))
        for x in range(3):
            row = scaled(shares[k], by_turn[x])
            store(
                jacobians[k + 1], x, plus(vector(jacobians[k + 1], x), times_transposed(matrix(inverses, i + k), row))
            )
            store(jacobians[k], x, minus(vector(jacobians[k], x), times(matrix(inverses, i + k), row)))
            rates[e, x] += rate[x]
        after = product(exp3(part_of_it), after)
    for x in range(3):
        store(jacobians[0], x, plus(vector(jacobians[0], x), transposed(after)[x]))
    store_matrix(r, e, product(matrix(rotations, i), after))


@kernel()
def _moved(rotations, positions, step):
    r, p, steps = np.empty_like(rotations), np.empty_like(positions), step.reshape(-1, 6)
    for k in range(len(rotations)):
        store_matrix(r, k, product(matrix(rotations, k), exp3(vector(steps, k))))
        store(p, k, plus(vector(positions, k), vector(steps, k, 3)))
    return r, p


@kernel()
def add_smoothness(rotations, positions, spacing, sigma_rad_s2, sigma_m_s2, hessian, right):
    """Adds a prior of zero accelerations to the normal equations; returns its cost.

    It is weak, and matters only where no image determines the motion. A cubic B-spline's acceleration at a knot is the
    second difference of the knots.
    """
    cost = 0.0
    wr, wp = 1.0 / (sigma_rad_s2 * spacing**2) ** 2, 1.0 / (sigma_m_s2 * spacing**2) ** 2
    by_knot, second = np.empty((3, 3, 3)), (1.0, -2.0, 1.0)
    turns, inverses = between_knots(rotations)
    for k in range(len(turns) - 1):
        before, after = matrix(inverses, k), matrix(inverses, k + 1)
        for x in range(3):
            store(by_knot[0], x, transposed(before)[x])
            store(by_knot[1], x, scaled(-1.0, plus(before[x], transposed(after)[x])))
            store(by_knot[2], x, after[x])
        r = minus(vector(turns, k + 1), vector(turns, k))
        q = plus(minus(vector(positions, k), scaled(2.0, vector(positions, k + 1))), vector(positions, k + 2))
        cost += 0.5 * (wr * dot(r, r) + wp * dot(q, q))
        for m in range(3):
            row, of_row = 6 * (k + m), transposed(matrix(by_knot, m))
            for x in range(3):
                right[row + x] -= wr * dot(of_row[x], r)
                right[row + 3 + x] -= wp * second[m] * q[x]
            for n in range(3):
                column, of_column = 6 * (k + n), transposed(matrix(by_knot, n))
                for x in range(3):
                    hessian[row + 3 + x, column + 3 + x] += wp * second[m] * second[n]
                    for y in range(3):
                        hessian[row + x, column + y] += wr * dot(of_row[x], of_column[y])
    return cost
