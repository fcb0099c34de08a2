"""Quadratic forms of the residuals of a window's tracks, and their expectations, which give the variance components.

The residuals of a track with n views, R coordinates each, are r = P e: e are its errors, P = I - Q Q' the projector on
what its point cannot follow, Q (n R, 3) an orthonormal basis of the derivatives by the point. For errors of covariance
C, a form r' S r has the expectation trace(S P C P) = trace(S C) - 2 trace(Q' S C Q) + trace(Q' S Q Q' C Q): quadratic
unbiased estimation of variance components, see Rao 1971.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.kernels import kernel, part
from ispom.numerics.robust import weighted_information
from ispom.numerics.vectors import dot, matrix, minus, plus, scaled, store, times_transposed, vector, vector3
from ispom.solvers.window.observation import MIN_DEPTH, correction, in_camera, longest_track, residual

SQUARES, INCREMENTS, RIGHT = 0, 1, 2
"""Forms: sums of the squares of a track's residuals x and y, of their increments from view to view, of the right x."""
WHITE, RANDOM_WALK, DISPARITY = 0, 1, 2
"""Covariances of variance 1: independent errors in each view, a random walk from view to view, errors of the right x
alone. An error of the left x is also one of the right x, which is searched from the left one."""
MIN_NORM = 1e-9
"""Least norm of a column of derivatives, relative to the largest one, after orthogonalisation; less is rounding."""


class ResidualForms(NamedTuple):
    """Sums over tracks, each with the mean of the robust weights of its observations."""

    expected: Array
    """(3, 3) expectations of the forms (rows) for the covariances (columns)."""
    found: Array
    """(3,) values of the forms."""
    weight: float
    lengths: Array
    """(2,) sums of the number of views and of its square, of tracks that begin in the oldest view."""
    weighted: Array
    """(K, 2) weighted errors x and y."""
    used: NDArray[np.bool_]
    """(K,) observations of the tracks summed."""


@kernel(fastmath={"contract"})
def residual_forms(observed, scale, least_views, gross):
    """Sums the forms of the tracks of `least_views` or more, without those with an error of `gross` scales."""
    n_seen, rows = len(observed.cameras), 3 if observed.baseline != 0.0 else 2
    longest = longest_track(observed.owners)
    basis, errors = np.empty((longest * rows, 3)), np.empty((longest, 3))
    forms, causes = np.empty((3, longest * rows, 3)), np.empty((3, longest * rows, 3))
    expected, found, lengths, weight = np.zeros((3, 3)), np.zeros(3), np.zeros(2), 0.0
    weighted, used = np.zeros((n_seen, 2)), np.zeros(n_seen, np.bool_)
    begin = 0
    while begin < n_seen:
        end = begin
        while end < n_seen and observed.owners[end] == observed.owners[begin]:
            end += 1
        n = end - begin
        if n >= least_views:
            likely = _linearise(begin, end, rows, observed, scale, gross, basis, errors, weighted)
            if likely > 0.0:
                used[begin:end] = True
                weight += likely
                if observed.cameras[begin] == 0:
                    lengths[0] += likely * n
                    lengths[1] += likely * n * n
                _orthonormalise(basis, n * rows)
                _apply_forms(n, rows, basis, forms)
                _apply_causes(n, rows, basis, causes)
                _add_expected(n, rows, basis, forms, causes, likely, expected)
                _add_found(n, errors, likely, found)
        begin = end
    return ResidualForms(expected, found, weight, lengths, weighted, used)


@part
def _linearise(begin, end, rows, observed, scale, gross, basis, errors, weighted):
    """Fills a track's derivatives by the point (n rows, 3) and errors (n, 3); returns its weight, 0 if unused."""
    likely, wrong = 0.0, correction(observed.extra)
    for k in range(begin, end):
        q, seen, rotation = (
            in_camera(observed, k),
            vector(observed.seen, k),
            matrix(observed.rotations, observed.cameras[k]),
        )
        if q[2] <= MIN_DEPTH or (rows == 3 and seen[2] != seen[2]):
            return 0.0
        x, y, right, ex, ey, er = residual(q, seen, observed.baseline, wrong)
        square, iz, n = (ex * ex + ey * ey + er * er) / (scale * scale), 1.0 / q[2], k - begin
        if not square < gross * gross:
            return 0.0
        weight = weighted_information(square, 1.0)
        likely += weight
        weighted[k, 0], weighted[k, 1] = ex * weight, ey * weight
        store(errors, n, (ex, ey, er))
        store(basis, n * rows, times_transposed(rotation, (iz, 0.0, -x * iz)))
        store(basis, n * rows + 1, times_transposed(rotation, (0.0, iz, -y * iz)))
        if rows == 3:
            store(basis, n * rows + 2, times_transposed(rotation, (iz, 0.0, -right * iz)))
    return likely / (end - begin)


@part
def _orthonormalise(a, n):
    """Orthonormalises the columns of a (n, 3), by Gram and Schmidt, each twice; dependent columns become 0."""
    largest = 0.0
    for d in range(3):
        size = 0.0
        for i in range(n):
            size += a[i, d] * a[i, d]
        largest = max(largest, size)
    for d in range(3):
        for _ in range(2):
            for c in range(d):
                share = 0.0
                for i in range(n):
                    share += a[i, c] * a[i, d]
                for i in range(n):
                    a[i, d] -= share * a[i, c]
        size = 0.0
        for i in range(n):
            size += a[i, d] * a[i, d]
        per = 1.0 / np.sqrt(size) if size > MIN_NORM * MIN_NORM * largest else 0.0
        for i in range(n):
            a[i, d] *= per


@part
def _apply_forms(n, rows, q, out):
    """Fills S Q of the three forms."""
    zero = (0.0, 0.0, 0.0)
    for i in range(n):
        for row in range(rows):
            at, left = i * rows + row, row < 2
            here = vector(q, at)
            change = zero
            if left and i > 0:
                change = minus(here, vector(q, at - rows))
            if left and i < n - 1:
                change = minus(change, minus(vector(q, at + rows), here))
            store(out[SQUARES], at, here if left else zero)
            store(out[INCREMENTS], at, change)
            store(out[RIGHT], at, zero if left else here)


@part
def _apply_causes(n, rows, q, out):
    """Fills C Q of the three covariances."""
    zero = (0.0, 0.0, 0.0)
    for i in range(n):
        at = i * rows
        x, y = vector(q, at), vector(q, at + 1)
        if rows == 3:
            right = vector(q, at + 2)
            x = plus(x, right)
            store(out[WHITE], at + 2, x)
            store(out[DISPARITY], at + 2, right)
        store(out[WHITE], at, x)
        store(out[WHITE], at + 1, y)
        store(out[DISPARITY], at, zero)
        store(out[DISPARITY], at + 1, zero)
    # a walk sums twice, as two views share min(i, j) steps
    for row in range(rows):
        ahead = zero
        for i in range(n - 1, 0, -1):
            at = i * rows + row
            ahead = plus(ahead, vector3(out, WHITE, at))
            store(out[RANDOM_WALK], at, ahead)
        walked = zero
        store(out[RANDOM_WALK], row, zero)
        for i in range(1, n):
            at = i * rows + row
            walked = plus(walked, vector3(out, RANDOM_WALK, at))
            store(out[RANDOM_WALK], at, walked)


@part
def _add_expected(n, rows, q, forms, causes, weight, expected):
    """Adds trace(S P C P) of a track's forms and covariances."""
    count, views = n * rows, float(n)
    traces = (
        (2.0 * views, views * (views - 1.0), 0.0),
        (4.0 * (views - 1.0), 2.0 * (views - 1.0), 0.0),
        (views, 0.5 * views * (views - 1.0), views),
    )
    for a in range(rows):
        s = _times_basis(count, q, forms, a)
        for b in range(rows):
            once = 0.0
            for i in range(count):
                once += dot(vector3(forms, a, i), vector3(causes, b, i))
            c = _times_basis(count, q, causes, b)
            twice = dot(s[0], c[0]) + dot(s[1], c[1]) + dot(s[2], c[2])
            expected[a, b] += weight * (traces[a][b] - 2.0 * once + twice)


@part
def _times_basis(count, q, some, a):
    """Returns Q' (S Q), symmetric."""
    x, y, z = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(count):
        own, other = vector(q, i), vector3(some, a, i)
        x = plus(x, scaled(own[0], other))
        y = plus(y, scaled(own[1], other))
        z = plus(z, scaled(own[2], other))
    return x, y, z


@part
def _add_found(n, errors, weight, found):
    """Adds the forms of a track's residuals."""
    squares, increments, right = 0.0, 0.0, 0.0
    for i in range(n):
        squares += errors[i, 0] * errors[i, 0] + errors[i, 1] * errors[i, 1]
        right += errors[i, 2] * errors[i, 2]
        if i > 0:
            dx, dy = errors[i, 0] - errors[i - 1, 0], errors[i, 1] - errors[i - 1, 1]
            increments += dx * dx + dy * dy
    found[SQUARES] += weight * squares
    found[INCREMENTS] += weight * increments
    found[RIGHT] += weight * right
