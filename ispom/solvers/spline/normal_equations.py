"""The normal equations of a spline from the observations of several cameras, without the points: hot loops of
`continuous`.

All loops are sequential, so results repeat bit for bit. Unknowns, in this order: six per knot (rotation, position),
then seven of the rig: rotation and position of the video camera, and its time offset.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.kernels import kernel, part
from ispom.numerics.vectors import cross, damped, dot, inverse, store, symmetric, vector
from ispom.solvers.spline.observation import MIN_DEPTH, RIG, empty_rows, linearise, placed, robust_weight


class Knots(NamedTuple):
    """The derivatives of the poses at the exposures by the knots: the arrays of spline.Sampled."""

    count: int
    first: NDArray[np.int64]
    rotation_jacobians: Array
    weights: Array
    rates: Array


class Reduced(NamedTuple):
    """Normal equations of knots and rig without the points. The terms of each pose are summed before they are mapped to
    its knots."""

    hessian: Array
    """(n, n), its lower triangle."""
    right: Array
    """(n,) right side."""
    poses: Array
    """(E, 6, 6) blocks of the poses."""
    poses_right: Array
    """(E, 6) right sides of the poses."""
    poses_rig: Array
    """(E, RIG, 6) blocks of rig and pose."""


class Eliminated(NamedTuple):
    """The data from which the steps of the points follow, given those of knots and rig."""

    inverses: Array
    """(M, 3, 3) inverses of the points' own blocks; zero without an observation before its camera."""
    sides: Array
    """(M, 3) right sides of the points."""
    mixed: Array
    """(O, 6, 3) blocks of pose and point, per observation."""
    mixed_rig: Array
    """(M, RIG, 3) blocks of rig and point."""
    scores: Array
    """(O, 6) negative gradients by a pose, per observation."""
    scores_rig: Array
    """(M, RIG) negative gradients by the rig."""


@kernel()
def reduce(knots, observed, depth_prior, loss, damping, with_rig, moved):
    """Returns Hessian (n, n) and right side (n,) of spline and rig, without the points; and the points' `Eliminated`.

    Observations are sorted by owner. Without `with_rig` the rig's rows stay zero. `depth_prior` (M, 2): expected
    inverse depth and its inverse variance. If `moved` (O, 3) is not empty, it replaces the errors in the right sides,
    with the weights of the actual errors; the Hessian is then incomplete.
    """
    n, exposures, points = 6 * knots.count + RIG, len(observed.rotations), len(observed.points)
    reduced = Reduced(
        np.zeros((n, n)),
        np.zeros(n),
        np.zeros((exposures, 6, 6)),
        np.zeros((exposures, 6)),
        np.zeros((exposures, RIG, 6)),
    )
    eliminated = Eliminated(
        np.zeros((points, 3, 3)),
        np.zeros((points, 3)),
        np.zeros((len(observed.owners), 6, 3)),
        np.zeros((points, RIG, 3)),
        np.zeros((len(observed.owners), 6)),
        np.zeros((points, RIG)),
    )
    rows, by_rig, spread, end = empty_rows(), np.empty((2, RIG)), np.empty((3, n)), np.int64(0)
    for m in range(points):
        begin = end
        end, low, high = _add_point(
            m, begin, knots, observed, depth_prior, loss, with_rig, moved, reduced, eliminated, rows, by_rig
        )
        if high > low:
            _invert(eliminated.inverses[m], damping)
            spread[:, low:high] = 0.0
            for o in range(begin, end):
                spread_over_knots(spread, knots, observed.exposures[o], eliminated.mixed[o])
            _eliminate(m, low, high, with_rig, len(moved) == 0, spread, reduced, eliminated)
        else:
            eliminated.inverses[m], eliminated.sides[m] = 0.0, 0.0
    by_knots = np.empty((RIG, 24))
    for e in range(exposures):
        _add_pose(e, knots, reduced, by_knots)
    for k in range(n):
        for j in range(k + 1, n):
            reduced.hessian[k, j] = reduced.hessian[j, k]
    return reduced.hessian, reduced.right, eliminated


@part
def _add_point(m, begin, knots, observed, depth_prior, loss, with_rig, moved, reduced, eliminated, rows, by_rig):
    """Adds the terms of point m, whose observations start at `begin`.

    Returns the end of the observations, and the range (first, end) of the knots' rows that they depend on.
    """
    eliminated.inverses[m, 2, 2] = depth_prior[m, 1]
    eliminated.sides[m, 2] = depth_prior[m, 1] * (depth_prior[m, 0] - observed.points[m, 2])
    o, low, high = begin, len(reduced.right), 0
    while o < len(observed.owners) and observed.owners[o] == m:
        rig, camera = placed(observed, o)
        if camera[2] > MIN_DEPTH:
            e, count = observed.exposures[o], linearise(rows, observed, o, rig, camera)
            weight = robust_weight(rows, count, loss)
            if len(moved):
                for i in range(count):
                    rows.errors[i] = -observed.inverse_sigma[o, i] * moved[o, i]
            _add_rows(m, o, count, weight, e, reduced, eliminated, rows)
            if with_rig and observed.cameras[o] == 0:
                fill_by_rig(by_rig, rows, camera, observed.points[m, 2], knots.rates, e)
                _add_rig(m, weight, e, 6 * knots.count, reduced, eliminated, rows, by_rig)
            low, high = min(low, 6 * knots.first[e]), max(high, 6 * knots.first[e] + 24)
        o += 1
    return o, low, high


@part
def _add_rows(m, o, count, weight, e, reduced, eliminated, rows):
    """Adds observation o of point m at exposure e to the blocks of pose and point."""
    block, side, mixed, score = eliminated.inverses[m], eliminated.sides[m], eliminated.mixed[o], eliminated.scores[o]
    pose, right = reduced.poses[e], reduced.poses_right[e]
    for i in range(count):
        for k in range(3):
            f = weight * rows.by_point[i, k]
            side[k] -= f * rows.errors[i]
            for j in range(3):
                block[k, j] += f * rows.by_point[i, j]
        for k in range(6):
            f = weight * rows.by_pose[i, k]
            right[k] -= f * rows.errors[i]
            score[k] -= f * rows.errors[i]
            for j in range(6):
                pose[k, j] += f * rows.by_pose[i, j]
            for j in range(3):
                mixed[k, j] += f * rows.by_point[i, j]


@part
def fill_by_rig(out, rows, camera, rho, rates, e):
    """Fills the derivatives (2, RIG) of the video camera's errors by the unknowns of the rig."""
    for i in range(2):
        by_camera, by_rig = vector(rows.by_camera, i), vector(rows.by_rig, i)
        out[i, 0], out[i, 1], out[i, 2] = cross(by_camera, camera)
        out[i, 3], out[i, 4], out[i, 5] = -rho * by_rig[0], -rho * by_rig[1], -rho * by_rig[2]
        out[i, 6] = 0.0
        for k in range(6):
            out[i, 6] += rows.by_pose[i, k] * rates[e, k]


@part
def _add_rig(m, weight, e, g, reduced, eliminated, rows, by_rig):
    """Adds an observation of point m by the video camera to the rig's blocks, which start at row g."""
    for k in range(RIG):
        f0, f1 = weight * by_rig[0, k], weight * by_rig[1, k]
        gradient = f0 * rows.errors[0] + f1 * rows.errors[1]
        reduced.right[g + k] -= gradient
        eliminated.scores_rig[m, k] -= gradient
        for j in range(6):
            reduced.poses_rig[e, k, j] += f0 * rows.by_pose[0, j] + f1 * rows.by_pose[1, j]
        for j in range(3):
            eliminated.mixed_rig[m, k, j] += f0 * rows.by_point[0, j] + f1 * rows.by_point[1, j]
        for j in range(RIG):
            reduced.hessian[g + k, g + j] += f0 * by_rig[0, j] + f1 * by_rig[1, j]


@part
def _invert(block, damping):
    """Replaces a point's block (3, 3) by the inverse of the damped block."""
    kept = block[0, 0], block[0, 1], block[0, 2], block[1, 1], block[1, 2], block[2, 2]
    a, b, c = symmetric(inverse(damped(kept, damping)))
    store(block, 0, a)
    store(block, 1, b)
    store(block, 2, c)


@part
def spread_over_knots(out, knots, e, mixed):
    """Adds a block (6, 3) of the pose at exposure e and a point to out (3, n), as blocks of the pose's knots."""
    for q in range(4):
        base, turn, weight = 6 * (knots.first[e] + q), knots.rotation_jacobians[e, q], knots.weights[e, q]
        for j in range(3):
            a, b, c = mixed[0, j], mixed[1, j], mixed[2, j]
            for k in range(3):
                out[j, base + k] += turn[0, k] * a + turn[1, k] * b + turn[2, k] * c
                out[j, base + 3 + k] += weight * mixed[3 + k, j]


@part
def _eliminate(m, low, high, with_rig, whole, spread, reduced, eliminated):
    """Schur complement of point m: subtracts M V^-1 M' and M V^-1 b from the terms of knots and rig.

    M are their blocks with the point. Without `whole` only the right side is computed.
    """
    inverted, side, of_rig = eliminated.inverses[m], vector(eliminated.sides, m), eliminated.mixed_rig[m]
    # Loops that count from zero along views become vector instructions; from `low` on they would not.
    row0, row1, row2 = spread[0, low:high], spread[1, low:high], spread[2, low:high]
    for k in range(high - low):
        a, b, c = gain(inverted, row0[k], row1[k], row2[k])
        reduced.right[low + k] -= dot((a, b, c), side)
        line = reduced.hessian[low + k, low:high]
        for j in range(k + 1 if whole else 0):
            line[j] -= a * row0[j] + b * row1[j] + c * row2[j]
    g = len(reduced.right) - RIG
    for k in range(RIG if with_rig else 0):
        a, b, c = gain(inverted, of_rig[k, 0], of_rig[k, 1], of_rig[k, 2])
        reduced.right[g + k] -= dot((a, b, c), side)
        line = reduced.hessian[g + k]
        for j in range(low, high):
            line[j] -= a * spread[0, j] + b * spread[1, j] + c * spread[2, j]
        for j in range(RIG):
            line[g + j] -= a * of_rig[j, 0] + b * of_rig[j, 1] + c * of_rig[j, 2]


@part
def gain(inverted, a, b, c):
    return (
        a * inverted[0, 0] + b * inverted[1, 0] + c * inverted[2, 0],
        a * inverted[0, 1] + b * inverted[1, 1] + c * inverted[2, 1],
        a * inverted[0, 2] + b * inverted[1, 2] + c * inverted[2, 2],
    )


@part
def _add_pose(e, knots, reduced, by_knots):
    """Adds the terms of the pose at exposure e to those of its four knots (lower triangle).

    `by_knots` (RIG, 24) is a buffer.
    """
    base, g = 6 * knots.first[e], len(reduced.right) - RIG
    _times_jacobian(by_knots, reduced.poses[e], knots, e)
    for q in range(4):
        turn, weight, first = knots.rotation_jacobians[e, q], knots.weights[e, q], base + 6 * q
        for k in range(3):
            right = reduced.poses_right[e]
            reduced.right[first + k] += turn[0, k] * right[0] + turn[1, k] * right[1] + turn[2, k] * right[2]
            reduced.right[first + 3 + k] += weight * right[3 + k]
            for j in range(6 * q + k + 1):
                reduced.hessian[first + k, base + j] += (
                    turn[0, k] * by_knots[0, j] + turn[1, k] * by_knots[1, j] + turn[2, k] * by_knots[2, j]
                )
            for j in range(6 * q + k + 4):
                reduced.hessian[first + 3 + k, base + j] += weight * by_knots[3 + k, j]
    _times_jacobian(by_knots, reduced.poses_rig[e], knots, e)
    for k in range(RIG):
        for j in range(24):
            reduced.hessian[g + k, base + j] += by_knots[k, j]


@part
def _times_jacobian(out, block, knots, e):
    """Fills the first n rows of out (RIG, 24): a block (n, 6) with the pose at exposure e, times its knots'
    Jacobian."""
    for k in range(len(block)):
        for q in range(4):
            turn, weight = knots.rotation_jacobians[e, q], knots.weights[e, q]
            for j in range(3):
                out[k, 6 * q + j] = block[k, 0] * turn[0, j] + block[k, 1] * turn[1, j] + block[k, 2] * turn[2, j]
                out[k, 6 * q + 3 + j] = weight * block[k, 3 + j]
