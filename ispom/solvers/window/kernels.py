"""The compiled parts of bundle adjustment in a window: normal equations without the points, and the points' steps.

With q a point in its camera, a pose's left twist moves q by B = [I | -[q]x] times it, and the point's own step moves q
by R: all derivatives of an observation follow from those by q. So 3 x 3 terms are summed first, and extended to 6 x 6
by B at the end.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ispom.geometry import Array
from ispom.kernels import kernel, part
from ispom.numerics.reprojection import add_by_twist, subtract_by_twists
from ispom.numerics.vectors import (
    congruent,
    cross,
    damped,
    damped_of_pair,
    dot,
    inverse,
    inverse_by_pivots,
    matrix,
    minus,
    plus,
    plus6,
    plus_square,
    product,
    product_transposed,
    scaled,
    store,
    store6,
    symmetric,
    times,
    times_transposed,
    transposed,
    vector,
    vector6,
)
from ispom.solvers.window.observation import (
    MIN_DEPTH,
    correction,
    fill_factors,
    fill_lens,
    in_camera,
    linearised,
    linearised_lens,
    longest_track,
)
from ispom.solvers.window.prior import LENS

LANES = 8
"""Number of corrections processed at a time: arrays have W columns, a multiple of it, filled with zeros."""


FIXED_WEIGHTS, OWN_CURVATURE = 0.0, 2.0
"""Values of `second_order`, see reduce_points."""
LEAST_SHARE = 0.1
"""Least curvature relative to that with fixed weights: a point with less in any direction constrains no poses."""


def padded(count: int) -> int:
    """Returns W for `count` corrections, which is `count` if that is less than LANES."""
    return count if count < LANES else -(-count // LANES) * LANES


class Reduced(NamedTuple):
    """Normal equations of C poses and E corrections, without the points."""

    blocks: Array
    """(C, C, 6, 6) blocks of pairs of poses, the first index not below the second."""
    side: Array
    """(C, 6, W) blocks of poses and corrections."""
    corner: Array
    """(E, W) block of the corrections."""
    by_poses: Array
    """(C, 6) gradient."""
    by_corrections: Array
    """(E,) gradient."""


class Eliminated(NamedTuple):
    """Data for the points' steps that follow from those of poses and corrections."""

    inverses: Array
    """(M, 6) inverses of the points' own symmetric blocks."""
    gradients: Array
    """(M, 3) gradients by the points."""
    mixed: Array
    """(K, 12) per observation: q, and the 3 x 3 matrix F for which B' F is the block of pose and point."""
    mixed_extra: Array
    """(M, 3, W) blocks of point and corrections."""


GRADIENT, MIXED, FACTORS = 6, 9, 12
"""First columns of parts of `terms` (L, 12 + W), which has a row for each observation of one point, weighted: second
derivatives by q (6), the gradient by q (3), the derivatives by q and the first correction (3), and the derivative by
each correction (W) as a multiple of that by the first. For a pair the last two are those of corrections that move the
right x. The same for its lens corrections, which stretch the left x and y, follows (3 + LENS)."""


@kernel(fastmath={"contract"})
def reduce_points(scale, damping, second_order, reduced, eliminated, observed):
    """Adds the normal equations of poses and corrections to `reduced`, the points eliminated; fills `eliminated`.

    Second derivatives are w J'J - `second_order` (w J'e) (w J'e)', with J the derivatives of an error e and w the
    robust weight: those of the loss itself for OWN_CURVATURE, where points that keep less than LEAST_SHARE are skipped;
    those with fixed weights for FIXED_WEIGHTS.
    """
    longest, end, per = longest_track(observed.owners), np.int64(0), 1.0 / (scale * scale)
    wide = FACTORS + eliminated.mixed_extra.shape[2]
    terms = np.zeros((longest, wide if observed.baseline == 0.0 else wide + 3 + LENS))
    views, shown, columns = len(reduced.blocks), reduced.corner.shape[0], reduced.corner.shape[1]
    discarded = Reduced(
        np.zeros((views, views, 6, 6)), np.zeros((views, 6, columns)), np.zeros((shown, columns)),
        np.zeros((views, 6)), np.zeros(shown),
    )  # fmt: skip
    for m in range(len(observed.points)):
        if second_order == FIXED_WEIGHTS or _is_curved(m, end, per, second_order, observed):
            end = _reduce_point(m, end, per, damping, second_order, reduced, eliminated, terms, observed)
        else:
            end = _reduce_point(m, end, per, damping, FIXED_WEIGHTS, discarded, eliminated, terms, observed)


@part
def _is_curved(m, begin, per, second_order, observed):
    """Checks that point m, whose observations start at `begin`, keeps LEAST_SHARE of its curvature in all
    directions."""
    fixed, rest, k = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), begin
    while k < len(observed.owners) and observed.owners[k] == m:
        q, rotation = in_camera(observed, k), matrix(observed.rotations, observed.cameras[k])
        if q[2] > MIN_DEPTH:
            seen, wrong = vector(observed.seen, k), correction(observed.extra)
            hessian, by_q, _, _, _ = linearised(q, seen, observed.baseline, wrong, per)
            _, own = congruent(rotation, hessian)
            fixed, rest = plus6(fixed, own), plus_square(rest, -second_order, times_transposed(rotation, by_q))
        k += 1
    a, b, c, d, e, f = fixed
    share = 1.0 - LEAST_SHARE
    return inverse_by_pivots(plus6(rest, (share * a, share * b, share * c, share * d, share * e, share * f)))[0] > 0.0


@part
def _reduce_point(m, begin, per, damping, second_order, reduced, eliminated, terms, observed):
    """Eliminates point m, whose observations start at `begin`; returns where they end."""
    end, block, gradient = _linearise(m, begin, per, second_order, reduced, eliminated, terms, observed)
    if observed.baseline == 0.0:
        inverted = inverse(damped(block, damping))
    else:
        _add_lenses(m, begin, end, per, second_order, reduced, eliminated, terms, observed)
        inverted = inverse_by_pivots(damped_of_pair(block, damping))
    store6(eliminated.inverses, m, inverted)
    store(eliminated.gradients, m, gradient)
    _eliminate_from_corrections(m, inverted, gradient, reduced, eliminated)
    for i in range(begin, end):
        _eliminate_from_pose(m, i, begin, end, inverted, gradient, reduced, eliminated, terms, observed.cameras)
    return end


@part
def _linearise(m, begin, per, second_order, reduced, eliminated, terms, observed):
    """Sums the observations of point m, from `begin` on; returns where they end, its own block (6) and gradient (3)."""
    block, gradient, k = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), begin
    wrong, baseline = correction(observed.extra), observed.baseline
    while k < len(observed.owners) and observed.owners[k] == m:
        n, q, rotation = k - begin, in_camera(observed, k), matrix(observed.rotations, observed.cameras[k])
        if q[2] > MIN_DEPTH:
            hessian, by_q, mixed, second, first = linearised(q, vector(observed.seen, k), baseline, wrong, per)
            if second_order > 0.0:
                hessian = plus_square(hessian, -second_order, by_q)
                mixed = minus(mixed, scaled(second_order * first, by_q))
                second -= second_order * first * first
            fill_factors(terms, n, FACTORS, q, observed, k)
            with_point, own = congruent(rotation, hessian)
            block, gradient = plus6(block, own), plus(gradient, times_transposed(rotation, by_q))
            _store_mixed(eliminated.mixed, k, q, with_point)
            _add_corrections(m, n, times_transposed(rotation, mixed), second, first, reduced, eliminated, terms)
            store6(terms, n, hessian)
            store(terms, n, by_q, GRADIENT)
            store(terms, n, mixed, MIXED)
        else:
            eliminated.mixed[k], terms[n] = 0.0, 0.0
        k += 1
    return k, block, gradient


@part
def _add_lenses(m, begin, end, per, second_order, reduced, eliminated, terms, observed):
    """Adds the derivatives of the left x and y of point m by a pair's first corrections to the corrections' blocks."""
    at, corner, baseline = terms.shape[1] - LENS, reduced.corner, observed.baseline
    for k in range(begin, end):
        n, q, rotation = k - begin, in_camera(observed, k), matrix(observed.rotations, observed.cameras[k])
        if q[2] > MIN_DEPTH:
            seen = vector(observed.seen, k)
            mixed, second, first = linearised_lens(q, seen, baseline, per)
            if second_order > 0.0:
                _, by_q, _, _, other = linearised(q, seen, baseline, correction(observed.extra), per)
                mixed, second = minus(mixed, scaled(second_order * first, by_q)), second - second_order * first * first
            store(terms, n, mixed, at - 3)
            fill_lens(terms, n, at, observed, k)
            if second_order > 0.0:
                _couple_lenses(n, at, second_order * first * other, corner, terms)
            by_point = times_transposed(rotation, mixed)
            for e in range(LENS):
                factor = terms[n, at + e]
                for d in range(3):
                    eliminated.mixed_extra[m, d, e] += by_point[d] * factor
                for d in range(LENS):
                    corner[e, d] += factor * second * terms[n, at + d]
                reduced.by_corrections[e] += factor * first


@part
def _couple_lenses(n, at, product, corner, terms):
    """Subtracts the second-order term between the corrections of the left x and y and of the right x from `corner`."""
    for e in range(LENS):
        for d in range(len(corner)):
            between = product * terms[n, at + e] * terms[n, FACTORS + d]
            corner[e, d] -= between
            corner[d, e] -= between


@part
def _store_mixed(out, k, q, m):
    """Fills row k of Eliminated.mixed."""
    out[k, 0], out[k, 1], out[k, 2] = q
    out[k, 3], out[k, 4], out[k, 5] = m[0]
    out[k, 6], out[k, 7], out[k, 8] = m[1]
    out[k, 9], out[k, 10], out[k, 11] = m[2]


@part
def mixed_of(mixed, k):
    """Returns q and F of row k of Eliminated.mixed."""
    return (mixed[k, 0], mixed[k, 1], mixed[k, 2]), (
        (mixed[k, 3], mixed[k, 4], mixed[k, 5]),
        (mixed[k, 6], mixed[k, 7], mixed[k, 8]),
        (mixed[k, 9], mixed[k, 10], mixed[k, 11]),
    )


@part
def _add_corrections(m, n, by_point, second, first, reduced, eliminated, terms):
    """Adds observation n of point m to the blocks of the corrections, from its derivatives by the first one."""
    corner, mixed = reduced.corner, eliminated.mixed_extra
    for d in range(3):
        for e in range(mixed.shape[2]):
            mixed[m, d, e] += by_point[d] * terms[n, FACTORS + e]
    for e in range(len(corner)):
        factor = terms[n, FACTORS + e]
        for d in range(corner.shape[1]):
            corner[e, d] += factor * second * terms[n, FACTORS + d]
        reduced.by_corrections[e] += factor * first


@part
def _eliminate_from_corrections(m, inverted, gradient, reduced, eliminated):
    """Schur complement: subtracts M V^-1 M' and M V^-1 b from the corrections' terms, M their block with the point."""
    mixed, corner = eliminated.mixed_extra, reduced.corner
    for e in range(len(corner)):
        a, b, c = times(symmetric(inverted), (mixed[m, 0, e], mixed[m, 1, e], mixed[m, 2, e]))
        for d in range(corner.shape[1]):
            corner[e, d] -= a * mixed[m, 0, d] + b * mixed[m, 1, d] + c * mixed[m, 2, d]
        reduced.by_corrections[e] -= dot(gradient, (a, b, c))


@part
def _eliminate_from_pose(m, i, begin, end, inverted, gradient, reduced, eliminated, terms, cameras):
    """Schur complement of observation i's pose: with the corrections, the gradient, and the later poses."""
    n, c, (q, f) = i - begin, cameras[i], mixed_of(eliminated.mixed, i)
    gain = product(f, symmetric(inverted))
    _eliminate_corrections_from_pose(m, n, c, q, gain, reduced.side, eliminated.mixed_extra, terms)
    add_by_twist(reduced.by_poses, c, q, minus(vector(terms, n, GRADIENT), times(gain, gradient)))
    own = _minus_symmetric(product_transposed(f, gain), vector6(terms, n))
    subtract_by_twists(reduced.blocks, c, c, q, own, q)
    for j in range(i + 1, end):
        u, other = mixed_of(eliminated.mixed, j)
        subtract_by_twists(reduced.blocks, cameras[j], c, u, product_transposed(other, gain), q)


@part
def _eliminate_corrections_from_pose(m, n, c, q, gain, side, mixed, terms):
    """Adds the block of a pose and the corrections, several corrections at a time."""
    own, (x, y, z) = vector(terms, n, MIXED), transposed(gain)
    own_turn, x_turn, y_turn, z_turn = cross(q, own), cross(q, x), cross(q, y), cross(q, z)
    for d in range(3):
        for e in range(side.shape[2]):
            with_point = x[d] * mixed[m, 0, e] + y[d] * mixed[m, 1, e] + z[d] * mixed[m, 2, e]
            side[c, d, e] += own[d] * terms[n, FACTORS + e] - with_point
        for e in range(side.shape[2]):
            with_point = x_turn[d] * mixed[m, 0, e] + y_turn[d] * mixed[m, 1, e] + z_turn[d] * mixed[m, 2, e]
            side[c, 3 + d, e] += own_turn[d] * terms[n, FACTORS + e] - with_point
    if terms.shape[1] > FACTORS + side.shape[2]:
        _add_lens_to_pose(n, c, q, side, terms)


@part
def _add_lens_to_pose(n, c, q, side, terms):
    """Adds the derivatives of the left x and y by the first corrections to the block of a pose."""
    at = terms.shape[1] - LENS
    own = vector(terms, n, at - 3)
    turn = cross(q, own)
    for e in range(LENS):
        for d in range(3):
            side[c, d, e] += own[d] * terms[n, at + e]
            side[c, 3 + d, e] += turn[d] * terms[n, at + e]


@part
def _minus_symmetric(m, s):
    a, b, c = symmetric(s)
    return minus(m[0], a), minus(m[1], b), minus(m[2], c)


@kernel(fastmath={"contract"})
def point_steps(cameras, owners, eliminated, pose_step, extra_step):
    """Back-substitution: returns the points' steps (M, 3) for those of the poses (C, 6) and corrections (E,)."""
    left = np.empty_like(eliminated.gradients)
    for m in range(len(left)):
        store(left, m, scaled(-1.0, vector(eliminated.gradients, m)))
    for k in range(len(cameras)):
        _subtract_pose_step(left, owners[k], k, eliminated, cameras[k], pose_step)
    for m in range(len(left)):
        _solve_point(left, m, eliminated, extra_step)
    return left


@part
def _subtract_pose_step(left, m, k, eliminated, c, step):
    q, f = mixed_of(eliminated.mixed, k)
    moved = plus((step[c, 0], step[c, 1], step[c, 2]), cross((step[c, 3], step[c, 4], step[c, 5]), q))
    store(left, m, minus(vector(left, m), times_transposed(f, moved)))


@part
def _solve_point(left, m, eliminated, extra_step):
    right = vector(left, m)
    for e in range(len(extra_step)):
        mixed = eliminated.mixed_extra[m, 0, e], eliminated.mixed_extra[m, 1, e], eliminated.mixed_extra[m, 2, e]
        right = minus(right, scaled(extra_step[e], mixed))
    store(left, m, times(symmetric(vector6(eliminated.inverses, m)), right))
