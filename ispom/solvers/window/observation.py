"""The observations of a window: errors, cost, and the derivatives of one by the point in its camera."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.kernels import kernel, part
from ispom.numerics.reprojection import gradient_by_point, hessian_by_point
from ispom.numerics.robust import weighted_information
from ispom.numerics.vectors import matrix, plus, times, vector

MIN_DEPTH = 1e-6
"""Points nearer are behind their camera."""
GROSS = 1e6
"""A point behind its camera costs what an error of a thousand scales does: its square."""


class Observed(NamedTuple):
    """The arrays of a window.Window of the same names; `seen` without what is wrong with a pair."""

    rotations: Array
    translations: Array
    points: Array
    cameras: NDArray[np.int64]
    owners: NDArray[np.int64]
    seen: Array
    factors: Array
    baseline: float
    extra: Array


@kernel()
def longest_track(owners):
    """The most observations of one point."""
    longest, length = 0, 0
    for k in range(len(owners)):
        length = length + 1 if k > 0 and owners[k] == owners[k - 1] else 1
        longest = max(longest, length)
    return longest


@kernel(fastmath={"contract"})
def squared_errors(observed):
    """(K,) over all images; inf behind the camera."""
    out, wrong = np.empty(len(observed.cameras)), correction(observed.extra)
    for k in range(len(out)):
        q = in_camera(observed, k)
        if q[2] <= MIN_DEPTH:
            out[k] = np.inf
        else:
            _, _, _, ex, ey, er = residual(q, vector(observed.seen, k), observed.baseline, wrong)
            out[k] = ex * ex + ey * ey + er * er
    return out


@part
def in_camera(observed, k):
    """The point of observation k in its camera."""
    c, point = observed.cameras[k], vector(observed.points, observed.owners[k])
    return plus(times(matrix(observed.rotations, c), point), vector(observed.translations, c))


@kernel()
def robust_cost(squares, scale):
    """Half the sum of log(1 + squared error in scales)."""
    total, product_of_32, per = 0.0, 1.0, 1.0 / (scale * scale)
    for k in range(len(squares)):
        # the logarithm of a product of 32 instead of 32 logarithms; 1e6 to the 32nd is still a number
        product_of_32 *= 1.0 + min(squares[k] * per, GROSS)
        if k % 32 == 31:
            total, product_of_32 = total + np.log(product_of_32), 1.0
    return 0.5 * (total + np.log(product_of_32))


@part
def correction(extra):
    """What is wrong with a single camera (see window.Window.extra)."""
    return extra[0], extra[1]


@part
def residual(q, seen, baseline, extra):
    """Image x, y, right x of a point q before its camera, and their errors; without a right place its error is 0."""
    iz = 1.0 / q[2]
    x, y, right, er = q[0] * iz, q[1] * iz, 0.0, 0.0
    ex, ey = x - seen[0], y - seen[1]
    if baseline == 0.0:
        stretch = extra[0] + extra[1] * (x * x + y * y)
        ex, ey = ex + stretch * x, ey + stretch * y
    elif seen[2] == seen[2]:
        right = x - baseline * iz
        er = right - seen[2]
    return x, y, right, ex, ey, er


@part
def by_image(x, y, seen_right, baseline, extra):
    """Derivatives of the errors: xx, xy, yy of those by x and y, rr of the right one by the right x.

    And x, y, right of all three by the first correction; of a pair by whatever moves the right x by one.
    """
    if baseline == 0.0:
        stretch, bend = 1.0 + extra[0] + extra[1] * (x * x + y * y), 2.0 * extra[1]
        return stretch + bend * x * x, bend * x * y, stretch + bend * y * y, 0.0, x, y, 0.0
    if seen_right == seen_right:
        # One, but no constant: with one, the products for a single camera are contracted otherwise, in the last digit.
        return 1.0, 0.0, 1.0, baseline / baseline, 0.0, 0.0, 1.0
    return 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0


@part
def fill_factors(out, n, first, q, observed, k):
    """Into row n of `out`, column `first` on (E): the errors' derivative by each correction over that of `by_image`."""
    count = observed.factors.shape[1]
    if observed.baseline == 0.0:
        iz, count = 1.0 / q[2], 0
        x, y = q[0] * iz, q[1] * iz
        out[n, first], out[n, first + 1] = 1.0, x * x + y * y
    for e in range(count):
        out[n, first + e] = observed.factors[k, e]


@part
def linearised(q, seen, baseline, extra, per):
    """With Cauchy's weight at errors in scales (`per`: 1 / scale^2), and all of it weighted:

    second derivatives (6) by q, gradient (3) by q, derivatives by q and the first correction (3), by the first
    correction twice, gradient by the first correction.
    """
    x, y, right, ex, ey, er = residual(q, seen, baseline, extra)
    xx, xy, yy, rr, ux, uy, ur = by_image(x, y, seen[2], baseline, extra)
    weight, iz = weighted_information(ex * ex + ey * ey + er * er, per), 1.0 / q[2]
    wz = weight * iz
    hessian = hessian_by_point(x, y, right, wz * iz, xx * xx + xy * xy, xy * (xx + yy), xy * xy + yy * yy, rr * rr)
    gradient = gradient_by_point(x, y, right, wz, xx * ex + xy * ey, xy * ex + yy * ey, rr * er)
    mixed = gradient_by_point(x, y, right, wz, xx * ux + xy * uy, xy * ux + yy * uy, rr * ur)
    return hessian, gradient, mixed, weight * (ux * ux + uy * uy + ur * ur), weight * (ux * ex + uy * ey + ur * er)


@part
def fill_lens(out, n, first, observed, k):
    """Into row n of `out`, column `first` on (LENS): by how much each correction of a pair's lenses makes the left x
    and y of observation k smaller, as a share (see right_camera.without_lens)."""
    x, y = observed.seen[k, 0], observed.seen[k, 1]
    square = x * x + y * y
    slope = 1.0 + (3.0 * observed.extra[0] + 5.0 * observed.extra[1] * square) * square
    out[n, first], out[n, first + 1] = square / slope, square * square / slope


@part
def linearised_lens(q, seen, baseline, per):
    """As the last three of `linearised`, by what stretches the left x and y of a pair."""
    x, y, right, ex, ey, er = residual(q, seen, baseline, (0.0, 0.0))
    weight = weighted_information(ex * ex + ey * ey + er * er, per)
    mixed = gradient_by_point(x, y, right, weight / q[2], seen[0], seen[1], 0.0)
    return mixed, weight * (seen[0] * seen[0] + seen[1] * seen[1]), weight * (seen[0] * ex + seen[1] * ey)
