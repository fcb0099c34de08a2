"""What is wrong with a rectified pair: the lens of both cameras, and what the right one has beside it: turned, another
focal length and lens, a late shutter.

All errors are small, so each moves what the right camera sees by its share of a fixed pattern over the image (Brown
1971 for the lens, signs as in OpenCV), at the place where a perfect camera would see it: with the one where it is seen,
lenses off by 0.01 would leave up to 0.7 px. The left camera has the lens of both alone: see window.Window. A turn about
x or y and a shift of the principal point differ in the second order only. So their sum is one unknown, the offset in
the middle of the image, which is well known; the turn is the other, and stands for what it does beside that.
Columns and rows tell a turn from decentring.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.kernels import kernel, part
from ispom.solvers.window.prior import Evidence

LEAST_DISPARITY = 1 / 2000
"""Normalised; a smaller one says no more than that the point is far."""
TERMS: tuple[str, ...] = (
    "both_k1", "both_k2", "offset_x", "pitch", "yaw", "roll", "focal", "k1", "k2", "p1", "p2", "q1", "q2", "ahead",
    "lag", "offset_y", "down",
)  # fmt: skip
"""The unknowns in their order: radial distortion of both cameras; and of the right one beside that: right in the middle
of the image [rad]; how it is turned about its own x, y, z axes [rad]; longer focal length, as a share; radial
distortion, decentring, and what it grows by with r^2; how much farther ahead it sits, over the baseline; how late its
shutter is [s]; down in the middle of the image [rad]; how much lower it sits, over the baseline. The focal length of
both is none: a drive straight ahead tells less of it than a board, and all lengths would follow it."""
PAIR = len(TERMS)
BOTH_K1, BOTH_K2, OFFSET_X, PITCH, YAW, ROLL, FOCAL, K1, K2, P1, P2, Q1, Q2, AHEAD, LAG = range(PAIR - 2)
OFFSET_Y, DOWN = PAIR - 2, PAIR - 1
BOTH = OFFSET_X
"""Terms of both cameras: the first ones. See `without_lens`."""
COLUMNS = OFFSET_Y
"""Terms that columns show: the first ones. Rows show all."""
INVERSIONS = 4
"""Steps of an iteration; each leaves a few hundredths of the error before."""
LEAST_S = 1e-5
"""Steps of the difference quotient are not smaller."""


def by_column(seen: Array, disparity: Array, late: Array | None = None) -> Array:
    """(N, COLUMNS) by how much x in the right image grows with each unknown, at ideal places (N, 2), normalised.

    `late` (N, 2): how x and y grow with the lag, see `drift`; without it the lag does nothing. 0 where a place is NaN.
    """
    late = np.zeros((len(seen), 2)) if late is None else late
    return _by_column(np.ascontiguousarray(seen), np.ascontiguousarray(disparity), np.ascontiguousarray(late))


@kernel()
def _by_column(seen, disparity, late):
    out = np.zeros((len(seen), COLUMNS))
    for n in range(len(seen)):
        fill_column(out, n, seen[n, 0], seen[n, 1], disparity[n], late[n, 0])
    return out


@part
def fill_column(out, n, x, y, disparity, late):
    """Row n of `by_column`, zeros before."""
    if x != x:
        return
    square, decentring = x * x + y * y, 2.0 * x * y
    out[n, OFFSET_X] = 1.0
    out[n, PITCH], out[n, YAW], out[n, ROLL], out[n, FOCAL] = x * y, -x * x, y, x
    out[n, K1], out[n, K2] = square * x, square * square * x
    out[n, BOTH_K1], out[n, BOTH_K2] = out[n, K1], out[n, K2]
    out[n, P1], out[n, P2] = decentring, square + 2.0 * x * x
    out[n, Q1], out[n, Q2] = square * out[n, P1], square * out[n, P2]
    out[n, AHEAD], out[n, LAG] = x * disparity, late


def by_row(seen: Array, disparity: Array, late: Array) -> Array:
    """(N, E) the same of how much lower a point lies than in the left image."""
    return _by_row(np.ascontiguousarray(seen), np.ascontiguousarray(disparity), np.ascontiguousarray(late))


@kernel()
def _by_row(seen, disparity, late):
    out = np.zeros((len(seen), PAIR))
    for n in range(len(seen)):
        x, y = seen[n, 0], seen[n, 1]
        square, left = x * x + y * y, (x + disparity[n]) ** 2 + y * y
        out[n, BOTH_K1], out[n, BOTH_K2] = (square - left) * y, (square * square - left * left) * y
        out[n, OFFSET_Y] = 1.0
        out[n, PITCH], out[n, YAW], out[n, ROLL], out[n, FOCAL] = y * y, -x * y, -x, y
        out[n, K1], out[n, K2] = square * y, square * square * y
        out[n, P1], out[n, P2] = square + 2.0 * y * y, 2.0 * x * y
        out[n, Q1], out[n, Q2] = square * out[n, P1], square * out[n, P2]
        out[n, DOWN], out[n, AHEAD], out[n, LAG] = -disparity[n], y * disparity[n], late[n, 1]
    return out


def lens_of_both(extra: Array) -> Array:
    """(3,) what is wrong with the left lens: share of the focal length, k1, k2."""
    return np.array([0.0, extra[BOTH_K1], extra[BOTH_K2]])


def without_lens(seen: Array, extra: Array) -> Array:
    """Places (N, 2) in the left image, normalised, without what is wrong with the lens of both; further columns stay.
    `seen` is the place times 1 + both_k1 r^2 + both_k2 r^4."""
    out = np.array(seen, np.float64, order="C")
    _remove_lens(out, float(extra[BOTH_K1]), float(extra[BOTH_K2]))
    return out


@kernel()
def _remove_lens(places, k1, k2):
    for n in range(len(places)):
        places[n, 0], places[n, 1] = lens_removed(places[n, 0], places[n, 1], k1, k2)


@part
def lens_removed(u, v, k1, k2):
    """`without_lens` of one place."""
    x, y = u, v
    for _ in range(INVERSIONS):
        square = x * x + y * y
        stretch = 1 + square * (k1 + square * k2)
        x, y = u / stretch, v / stretch
    return x, y


def without_errors(seen: Array, extra: Array, late: Array | None = None) -> Array:
    """Observations (N, 3) of x, y in the left image and x in the right one, normalised, as a perfect pair's; NaN stays.

    `late` as of `by_column`.
    """
    late = np.zeros((len(seen), 2)) if late is None else late
    return _without_errors(np.ascontiguousarray(seen), extra, np.ascontiguousarray(late))


@kernel()
def _without_errors(seen, extra, late):
    out, factors = np.empty((len(seen), 3)), np.zeros((1, COLUMNS))
    for n in range(len(seen)):
        x, y = lens_removed(seen[n, 0], seen[n, 1], extra[BOTH_K1], extra[BOTH_K2])
        out[n, 0], out[n, 1] = x, y
        out[n, 2] = fill_ideal_column(factors, 0, x, y, seen[n, 2], extra, late[n, 0])
    return out


@part
def fill_ideal_column(out, n, x, y, right, extra, late):
    """Row n of `by_column` where a perfect pair would see what the left camera without its errors sees at x, y and the
    right one, with them, at `right`; zeros before. That place's x."""
    ideal = right
    for _ in range(INVERSIONS):
        fill_column(out, n, ideal, y, x - ideal, late)
        wrong = 0.0
        for i in range(COLUMNS):
            wrong += out[n, i] * extra[i]
        ideal = right - wrong
    return ideal


def drift(xyz: Array, rates: Array, lag: float, baseline: float) -> Array:
    """(N, 2) how much x and y in the right image grow per second of lag, of points (N, 3) of the left camera.

    `rates` (N, 6), or (1, 6) of all: change of camera_from_world (rho [m/s], phi [rad/s]; left). About `lag`: it is not
    quite linear.
    """
    return _drift(np.ascontiguousarray(xyz), np.ascontiguousarray(rates), float(lag), float(baseline))


@kernel()
def _drift(xyz, rates, lag, baseline):
    out = np.empty((len(xyz), 2))
    for n in range(len(xyz)):
        out[n, 0], out[n, 1] = drift_of((xyz[n, 0], xyz[n, 1], xyz[n, 2]), rates, min(n, len(rates) - 1), lag, baseline)
    return out


@part
def drift_of(point, rates, n, lag, baseline):
    """`drift` of one point by the rate of row n."""
    x, y, depth = point
    z = 1e-6 if depth < 1e-6 else depth
    step = lag if abs(lag) > LEAST_S else LEAST_S
    a, b, c = rates[n, 3], rates[n, 4], rates[n, 5]
    right = x - baseline
    dx = rates[n, 0] + (b * depth - c * y)
    dy = rates[n, 1] + (c * x - a * depth)
    dz = rates[n, 2] + (a * y - b * x)
    later = max(z + step * dz, 0.5 * z)
    return ((right + step * dx) / later - right / z) / step, ((y + step * dy) / later - y / z) / step


def row_evidence(
    ids: NDArray[np.int64],
    factors: Array,
    lower: Array,
    extra: Array,
    covariance: Array,
    scale: float,
    iterations: int = 5,
) -> Evidence:
    """What points (N,) say that lie `lower` (N,) in the right image than in the left one, normalised; NaN if unknown.

    `factors` (N, E) as of `by_row`, `extra` and `covariance` what is known without them; Cauchy loss of scale `scale`.
    Rows have next to nothing to say of points and poses, beside the left image's rows from which they are found.
    """
    good = np.isfinite(lower) & np.isfinite(factors).all(1)
    design, rows, ids = factors[good], lower[good], ids[good]
    if not len(rows):
        return Evidence(design, rows, rows, ids)
    free, root = np.diag(covariance) > 0, np.ones(len(rows))
    known, error = np.linalg.inv(covariance[np.ix_(free, free)]), rows - design @ extra
    start, part, middle = error, design[:, free], len(rows) // 2
    for _ in range(iterations):
        # As wide as the errors still are.
        wide = max(scale, 1.5 * float(np.partition(np.abs(error), middle)[middle]))
        weight = 1 / (wide**2 + error**2)
        weighted, root = part.T * weight, np.sqrt(weight)
        inverse = np.linalg.inv(known + weighted @ part)
        error = start - part @ (inverse @ (weighted @ start))
    drawn = np.einsum("ni,in->n", part @ inverse, weighted)
    return Evidence(design * root[:, None], rows * root, -error * root / (1 - drawn), ids)
