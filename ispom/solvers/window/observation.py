"""The observations of a window: errors, cost, and the derivatives of an observation by the point in its camera."""

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
"""Depth below which a point is behind its camera, in the unit of the world."""
MAX_SQUARE = 1e6
"""Largest squared error that the cost counts, in squared scales, also that of a point behind its camera: (1000)^2."""


class Observed(NamedTuple):
    """The arrays of window.Window with the same names; for a pair `seen` is corrected (right_camera.without_errors)."""

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
    """Returns the largest number of observations of one point."""
    longest, length = 0, 0
    for k in range(len(owners)):
        length = length + 1 if k > 0 and owners[k] == owners[k - 1] else 1
        longest = max(longest, length)
    return longest


@kernel(fastmath={"contract"})
def squared_errors(observed):
    """Returns the squared errors (K,) over both images; inf behind the camera."""
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
    """Returns the point of observation k in its camera."""
    c, point = observed.cameras[k], vector(observed.points, observed.owners[k])
    return plus(times(matrix(observed.rotations, c), point), vector(observed.translations, c))


@kernel()
def robust_cost(squares, scale):
    """Returns half the sum of log(1 + squared error / scale^2)."""
    total, product_of_32, per = 0.0, 1.0, 1.0 / (scale * scale)
    for k in range(len(squares)):
        # the logarithm of a product of 32 instead of 32 logarithms; 1e6 to the 32nd is still a number
        product_of_32 *= 1.0 + min(squares[k] * per, MAX_SQUARE)
        if k % 32 == 31:
            total, product_of_32 = total + np.log(product_of_32), 1.0
    return 0.5 * (total + np.log(product_of_32))


@part
def correction(extra):
    """Returns the corrections of a single camera: focal length, radial distortion (see window.Window.extra)."""
    return extra[0], extra[1]


@part
def residual(q, seen, baseline, extra):
    """Returns x, y, right x of a point q before its camera, and their errors; that of an unobserved right x is 0."""
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
    """Returns the derivatives of the errors: xx, xy, yy by x and y; rr of the right one by the right x; and those of
    all three by the first correction, for a pair by one that moves the right x by 1."""
    if baseline == 0.0:
        stretch, bend = 1.0 + extra[0] + extra[1] * (x * x + y * y), 2.0 * extra[1]
        return stretch + bend * x * x, bend * x * y, stretch + bend * y * y, 0.0, x, y, 0.0
    if seen_right == seen_right:
        # This is 1, but not a constant, which would change the last digit of the contracted products of one camera.
        return 1.0, 0.0, 1.0, baseline / baseline, 0.0, 0.0, 1.0
    return 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0


@part
def fill_factors(out, n, first, q, observed, k):
    """Fills row n of `out`, from column `first` on (E): the errors' derivative by each correction, as a multiple of
    that of `by_image`."""
    count = observed.factors.shape[1]
    if observed.baseline == 0.0:
        iz, count = 1.0 / q[2], 0
        x, y = q[0] * iz, q[1] * iz
        out[n, first], out[n, first + 1] = 1.0, x * x + y * y
    for e in range(count):
        out[n, first + e] = observed.factors[k, e]


@part
def linearised(q, seen, baseline, extra, per):
    """Returns the derivatives of an observation's cost, with the robust weight; `per` is 1 / scale^2.

    These are the second derivatives (6) by q, the gradient (3) by q, the mixed derivatives (3) by q and the first
    correction, the second derivative by the first correction, and the gradient by the first correction.
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
    """Fills row n of `out`, from column `first` on (LENS): the relative decrease of the left x and y of observation k
    by each lens correction of a pair (see right_camera.without_lens)."""
    x, y = observed.seen[k, 0], observed.seen[k, 1]
    square = x * x + y * y
    slope = 1.0 + (3.0 * observed.extra[0] + 5.0 * observed.extra[1] * square) * square
    out[n, first], out[n, first + 1] = square / slope, square * square / slope


@part
def linearised_lens(q, seen, baseline, per):
    """Returns the last three results of `linearised`, for a correction that stretches the left x and y of a pair."""
    x, y, right, ex, ey, er = residual(q, seen, baseline, (0.0, 0.0))
    weight = weighted_information(ex * ex + ey * ey + er * er, per)
    mixed = gradient_by_point(x, y, right, weight / q[2], seen[0], seen[1], 0.0)
    return mixed, weight * (seen[0] * seen[0] + seen[1] * seen[1]), weight * (seen[0] * ex + seen[1] * ey)
