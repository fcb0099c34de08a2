"""Scores of a window's tracks: the gradient of each track's cost by poses and corrections, its point eliminated.

See `covariance` for what they are used for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.kernels import kernel, part
from ispom.numerics.vectors import (
    cross,
    dot,
    matrix,
    minus,
    plus,
    scaled,
    store,
    symmetric,
    times,
    times_transposed,
    vector,
    vector6,
)
from ispom.solvers.window.kernels import Eliminated, mixed_of
from ispom.solvers.window.observation import (
    MIN_DEPTH,
    Observed,
    correction,
    fill_factors,
    fill_lens,
    in_camera,
    linearised,
    linearised_lens,
    longest_track,
)
from ispom.solvers.window.prior import LENS, POSE


def track_scores(observed: Observed, eliminated: Eliminated, corrections: int, scale: float) -> Array:
    """Returns the score (M, 6 C + E) of each track by left twists and corrections.

    `eliminated` is of these observations, without damping; E the number of `corrections`, `scale` the loss width.
    """
    out = np.zeros((len(observed.points), POSE * len(observed.rotations) + corrections))
    _scores(observed, eliminated, 1 / scale**2, out)
    return out


def score_changes(
    observed: Observed,
    eliminated: Eliminated,
    scale: float,
    second_order: float,
    groups: NDArray[np.int64],
    moved: Array,
) -> Array:
    """Returns the change (G, D) of the scores of each group of tracks with its changes `moved` (G, D) of the unknowns.

    The points follow. `groups` (M,) is the group of each track; `second_order` is that of `eliminated`, see
    kernels.reduce_points.
    """
    out = np.zeros_like(moved)
    _changes(observed, eliminated, 1 / scale**2, second_order, groups, moved, out)
    return out


@kernel(fastmath={"contract"})
def _scores(observed, eliminated, per, out):
    end, longest = np.int64(0), longest_track(observed.owners)
    by_q, shown = np.empty((longest, 3)), observed.factors.shape[1] if observed.baseline != 0.0 else LENS
    factors = np.zeros((1, shown + LENS))
    for m in range(len(observed.points)):
        begin, by_point, into = end, (0.0, 0.0, 0.0), out[m]
        while end < len(observed.owners) and observed.owners[end] == m:
            q, own = in_camera(observed, end), (0.0, 0.0, 0.0)
            if q[2] > MIN_DEPTH:
                own = _gradient(end, q, observed, per, factors, into)
            store(by_q, end - begin, own)
            by_point = plus(by_point, times_transposed(matrix(observed.rotations, observed.cameras[end]), own))
            end += 1
        _eliminate(m, begin, end, shown, observed, eliminated, by_point, by_q, into)


@kernel(fastmath={"contract"})
def _changes(observed, eliminated, per, second_order, groups, moved, out):
    end, longest = np.int64(0), longest_track(observed.owners)
    by_q, shown = np.empty((longest, 3)), observed.factors.shape[1] if observed.baseline != 0.0 else LENS
    factors = np.zeros((1, shown + LENS))
    for m in range(len(observed.points)):
        begin, by_point, into = end, (0.0, 0.0, 0.0), out[groups[m]]
        while end < len(observed.owners) and observed.owners[end] == m:
            q, own = in_camera(observed, end), (0.0, 0.0, 0.0)
            if q[2] > MIN_DEPTH:
                own = _gradient_change(end, q, observed, per, second_order, groups[m], moved, factors, into)
            store(by_q, end - begin, own)
            by_point = plus(by_point, times_transposed(matrix(observed.rotations, observed.cameras[end]), own))
            end += 1
        _eliminate(m, begin, end, shown, observed, eliminated, by_point, by_q, into)


@part
def _gradient(k, q, observed, per, factors, out):
    """Gradient (3,) of observation k's cost by its point `q` in the camera; adds that by the corrections to `out`."""
    seen, count, lenses, lens_first = vector(observed.seen, k), factors.shape[1] - LENS, 0, 0.0
    _, by_q, _, _, first = linearised(q, seen, observed.baseline, correction(observed.extra), per)
    fill_factors(factors, 0, 0, q, observed, k)
    fill_lens(factors, 0, count, observed, k)
    if observed.baseline != 0.0:
        lenses, (_, _, lens_first) = LENS, linearised_lens(q, seen, observed.baseline, per)
    first_of = POSE * len(observed.rotations)
    for e in range(count):
        out[first_of + e] += first * factors[0, e]
    for e in range(lenses):
        out[first_of + e] += lens_first * factors[0, count + e]
    return by_q


@part
def _gradient_change(k, q, observed, per, second_order, g, moved, factors, out):
    """Change of `_gradient` with poses and corrections `moved[g]` (D,), for a fixed point."""
    count, lenses, at = factors.shape[1] - LENS, 0, POSE * observed.cameras[k]
    seen, turn = vector(observed.seen, k), vector(moved, g, at + 3)
    hessian, by_q, mixed, second, first = linearised(q, seen, observed.baseline, correction(observed.extra), per)
    fill_factors(factors, 0, 0, q, observed, k)
    fill_lens(factors, 0, count, observed, k)
    lens_mixed, lens_second, lens_first = (0.0, 0.0, 0.0), 0.0, 0.0
    if observed.baseline != 0.0:
        lenses, (lens_mixed, lens_second, lens_first) = LENS, linearised_lens(q, seen, observed.baseline, per)
    first_of = POSE * len(observed.rotations)
    v, grown, stretched = plus(vector(moved, g, at), cross(turn, q)), 0.0, 0.0
    for e in range(count):
        grown += factors[0, e] * moved[g, first_of + e]
    for e in range(lenses):
        stretched += factors[0, count + e] * moved[g, first_of + e]
    change = plus(plus(times(symmetric(hessian), v), scaled(grown, mixed)), scaled(stretched, lens_mixed))
    rise = dot(by_q, v) + first * grown + lens_first * stretched
    own = second * grown + dot(mixed, v) - second_order * first * rise
    lens = lens_second * stretched + dot(lens_mixed, v) - second_order * lens_first * rise
    for e in range(count):
        out[first_of + e] += own * factors[0, e]
    for e in range(lenses):
        out[first_of + e] += lens * factors[0, count + e]
    return minus(change, scaled(second_order * rise, by_q))


@part
def _eliminate(m, begin, end, shown, observed, eliminated, by_point, by_q, out):
    """Adds the gradients by poses to `out` (D,), from those by the point in each camera, and eliminates point m, whose
    own gradient is `by_point`, from poses and the first corrections, which observations depend on (`shown`)."""
    step = times(symmetric(vector6(eliminated.inverses, m)), by_point)
    corrections, mixed = POSE * len(observed.rotations), eliminated.mixed_extra
    for k in range(begin, end):
        q, f = mixed_of(eliminated.mixed, k)
        _add_by_twist(out, POSE * observed.cameras[k], q, minus(vector(by_q, k - begin), times(f, step)))
    for e in range(shown):
        out[corrections + e] -= dot(step, (mixed[m, 0, e], mixed[m, 1, e], mixed[m, 2, e]))


@part
def _add_by_twist(out, at, q, v):
    x, y, z = cross(q, v)
    out[at] += v[0]
    out[at + 1] += v[1]
    out[at + 2] += v[2]
    out[at + 3] += x
    out[at + 4] += y
    out[at + 5] += z
