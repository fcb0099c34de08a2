"""How the cost of a window of one camera curves, the points eliminated, by the loss's own second derivatives; and what
each point by itself says of the slope.

With J the derivatives of an error e (2,), and w Cauchy's weight, the loss has the second derivatives
w J'J - 2 (w J'e) (w J'e)'; with weights held they are w J'J.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ispom.geometry import Array
from ispom.kernels import kernel, part
from ispom.numerics.robust import weighted_information
from ispom.numerics.vectors import (
    inverse_by_pivots,
    matrix,
    minus,
    plus,
    plus6,
    plus_square,
    scaled,
    store,
    store_matrix,
    symmetric,
    times,
    times_transposed,
    vector3,
)
from ispom.solvers.window.observation import MIN_DEPTH, Observed, in_camera, longest_track
from ispom.solvers.window.prior import LENS, POSE


class Curved(NamedTuple):
    """Of K observations of M points, by D = 6 C + 2 unknowns: left twists of poses, and corrections of the camera."""

    design: Array
    """(K, 2, 8) first derivatives of each error, by the pose that it has and by the corrections."""
    by_point: Array
    """(K, 2, 3)."""
    weight: Array
    """(K,) that the loss gives."""
    reduced: Array
    """(D, D) second derivatives of the cost, the points eliminated."""
    scores: Array
    """(M, D) first ones, of each point by itself, the point eliminated."""
    conditional: Array
    """(M, 3, 3) inverse of the second ones by each point, weights held."""
    mixed: Array
    """(M, 3, D) second ones by each point, and by poses and corrections, weights held."""


def curved(observed: Observed, scale: float, least_share: float) -> Curved:
    """`scale`: width of the loss. A point has no part in `reduced` where some direction of it keeps less than
    `least_share` of the curvature that it has with weights held."""
    k, m, d = len(observed.cameras), len(observed.points), POSE * len(observed.rotations) + LENS
    out = Curved(
        np.empty((k, 2, POSE + LENS)), np.empty((k, 2, 3)), np.empty(k),
        np.zeros((d, d)), np.zeros((m, d)), np.empty((m, 3, 3)), np.zeros((m, 3, d)),
    )  # fmt: skip
    _curve(observed, scale, least_share, out)
    return out


@kernel(fastmath={"contract"})
def _curve(observed, scale, least_share, out):
    longest = longest_track(observed.owners)
    errors, half, slope = np.empty((longest, 2)), np.empty((3, POSE * longest + LENS)), np.empty(POSE + LENS)
    end = np.int64(0)  # another kind of number would be compiled for once more
    for m in range(len(observed.points)):
        begin = end
        while end < len(observed.owners) and observed.owners[end] == m:
            end += 1
        bends, held, pull = _linearise(begin, end, observed, scale, errors, out)
        least = 1e-12 * (1.0 + held[0] + held[3] + held[5])
        held = plus6(held, (least, 0.0, 0.0, least, 0.0, least))
        conditional = symmetric(inverse_by_pivots(held))
        store_matrix(out.conditional, m, conditional)
        a, b, c, d, e, f = held
        share = -least_share
        less = plus6(bends, (share * a, share * b, share * c, share * d, share * e, share * f))
        sure = inverse_by_pivots(less)[0] > 0.0
        _spread(m, begin, end, times(conditional, pull), sure, observed, errors, half, slope, out)
        if sure:
            _eliminate(begin, end, bends, observed, half, out.reduced)
    for i in range(len(out.reduced)):
        for j in range(i):
            out.reduced[i, j] = out.reduced[j, i]


@part
def _linearise(begin, end, observed, scale, errors, out):
    """Fills errors (n, 2), derivatives and weights of one point's observations; its own second derivatives (6), these
    with weights held, and its first ones (3)."""
    bends, held, pull = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(begin, end):
        q, rotation, design = in_camera(observed, k), matrix(observed.rotations, observed.cameras[k]), out.design[k]
        front = q[2] > MIN_DEPTH
        iz = 1.0 / q[2] if front else 1.0
        x, y = q[0] * iz, q[1] * iz
        square = x * x + y * y
        stretch = 1.0 + observed.extra[0] + observed.extra[1] * square
        ex, ey = stretch * x - observed.seen[k, 0], stretch * y - observed.seen[k, 1]
        weight = weighted_information(ex * ex + ey * ey, 1.0 / (scale * scale)) if front else 0.0
        errors[k - begin, 0], errors[k - begin, 1], out.weight[k] = ex, ey, weight
        store(design, 0, (iz, 0.0, -x * iz))
        store(design, 0, (-x * y, 1.0 + x * x, -y), 3)
        design[0, 6], design[0, 7] = x, x * square
        store(design, 1, (0.0, iz, -y * iz))
        store(design, 1, (-1.0 - y * y, x * y, x), 3)
        design[1, 6], design[1, 7] = y, y * square
        by_x = times_transposed(rotation, (iz, 0.0, -x * iz))
        by_y = times_transposed(rotation, (0.0, iz, -y * iz))
        store(out.by_point[k], 0, by_x)
        store(out.by_point[k], 1, by_y)
        own = plus(scaled(weight * ex, by_x), scaled(weight * ey, by_y))
        pull = plus(pull, own)
        held = plus_square(plus_square(held, weight, by_x), weight, by_y)
        bends = plus_square(bends, -2.0, own)
    return plus6(held, bends), held, pull


@part
def _spread(m, begin, end, step, sure, observed, errors, half, slope, out):
    """One point's part in `mixed`, `scores`, and, if `sure`, in the upper triangle of `reduced`, itself not eliminated
    yet; into `half` (3, 6 n + 2) the second derivatives by it and by the rest. `step`: of the point alone."""
    corrections, last = POSE * len(observed.rotations), POSE * (end - begin)
    half[:, last:] = 0.0
    for k in range(begin, end):
        first, to, design, weight = POSE * observed.cameras[k], POSE * (k - begin), out.design[k], out.weight[k]
        ex, ey = weight * errors[k - begin, 0], weight * errors[k - begin, 1]
        by_x, by_y = scaled(weight, vector3(out.by_point, k, 0)), scaled(weight, vector3(out.by_point, k, 1))
        own = plus(scaled(errors[k - begin, 0], by_x), scaled(errors[k - begin, 1], by_y))
        for r in range(POSE + LENS):
            at, local = (first + r, to + r) if r < POSE else (corrections + r - POSE, last + r - POSE)
            slope[r] = ex * design[0, r] + ey * design[1, r]
            held = plus(scaled(design[0, r], by_x), scaled(design[1, r], by_y))
            bent = minus(held, scaled(2.0 * slope[r], own))
            out.scores[m, at] += slope[r] - step[0] * held[0] - step[1] * held[1] - step[2] * held[2]
            for d in range(3):
                out.mixed[m, d, at] += held[d]
                half[d, local] = bent[d] if r < POSE else half[d, local] + bent[d]
            if sure:
                for s in range(r + 1):
                    row = first + s if s < POSE else corrections + s - POSE
                    products = design[0, s] * design[0, r] + design[1, s] * design[1, r]
                    out.reduced[row, at] += weight * products - 2.0 * slope[s] * slope[r]


@part
def _eliminate(begin, end, own, observed, half, reduced):
    """Takes W' V^-1 W from the upper triangle of `reduced`: W is in `half`, V = L L' the point's own block; W becomes
    L^-1 W."""
    a = np.sqrt(own[0])
    b, c = own[1] / a, own[2] / a
    d = np.sqrt(own[3] - b * b)
    e = (own[4] - b * c) / d
    f = np.sqrt(own[5] - c * c - e * e)
    n = end - begin
    for r in range(POSE * n + LENS):
        half[0, r] /= a
        half[1, r] = (half[1, r] - b * half[0, r]) / d
        half[2, r] = (half[2, r] - c * half[0, r] - e * half[1, r]) / f
    for i in range(n + 1):
        first, size = (POSE * observed.cameras[begin + i], POSE) if i < n else (POSE * len(observed.rotations), LENS)
        for r in range(size):
            x, y, z = half[0, POSE * i + r], half[1, POSE * i + r], half[2, POSE * i + r]
            row = reduced[first + r]
            for j in range(i, n):
                at = POSE * observed.cameras[begin + j]
                for s in range(POSE):
                    row[at + s] -= x * half[0, POSE * j + s] + y * half[1, POSE * j + s] + z * half[2, POSE * j + s]
            at = POSE * len(observed.rotations)
            for s in range(LENS):
                row[at + s] -= x * half[0, POSE * n + s] + y * half[1, POSE * n + s] + z * half[2, POSE * n + s]


@kernel(fastmath={"contract"})
def left_out(observed, found, moved):
    """(M, D) scores as they would be, to first order, had each track had no part in where poses and corrections are:
    it moves them by `moved` (M, D)."""
    out, corrections, end = found.scores.copy(), POSE * len(observed.rotations), np.int64(0)
    for m in range(len(out)):
        begin, held = end, (0.0, 0.0, 0.0)
        while end < len(observed.owners) and observed.owners[end] == m:
            x, y = _shift(end, m, corrections, observed.cameras, found.design, moved)
            by_x, by_y = vector3(found.by_point, end, 0), vector3(found.by_point, end, 1)
            held = plus(held, scaled(found.weight[end], plus(scaled(x, by_x), scaled(y, by_y))))
            end += 1
        back = times(matrix(found.conditional, m), held)
        for k in range(begin, end):
            x, y = _shift(k, m, corrections, observed.cameras, found.design, moved)
            for d in range(3):
                x, y = x - found.by_point[k, 0, d] * back[d], y - found.by_point[k, 1, d] * back[d]
            x, y = found.weight[k] * x, found.weight[k] * y
            for r in range(POSE + LENS):
                at = POSE * observed.cameras[k] + r if r < POSE else corrections + r - POSE
                out[m, at] += x * found.design[k, 0, r] + y * found.design[k, 1, r]
    return out


@part
def _shift(k, m, corrections, cameras, design, moved):
    """How far track m moves the image of its observation k: x, y."""
    x, y = 0.0, 0.0
    for r in range(POSE + LENS):
        step = moved[m, POSE * cameras[k] + r] if r < POSE else moved[m, corrections + r - POSE]
        x, y = x + design[k, 0, r] * step, y + design[k, 1, r] * step
    return x, y
