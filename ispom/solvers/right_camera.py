"""Calibration errors of a rectified stereo pair: 17 corrections, and how the right image depends on them.

Two corrections (`both_k1`, `both_k2`) are distortion that both cameras share. All others are errors of the right camera
relative to the left one: rotation, focal length, distortion, position, and delay of the shutter.

The errors are small, so the model is linear: each correction, times a fixed pattern over the image, shifts the points
in the right image (Brown 1971 for distortion, signs as in OpenCV). The pattern is evaluated at the position that a
perfect camera would observe. At the observed position instead, distortion errors of 0.01 would leave up to 0.7 px. The
left camera has the shared distortion only, see window.Window.

A rotation about x or y and a shift of the principal point differ to second order only. So their common shift, the
offset in the middle of the image, is one well-determined unknown. `pitch` and `yaw` are the second-order remainder.
Columns and rows together distinguish rotation from decentring.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.kernels import kernel, part
from ispom.solvers.window.prior import Evidence

LEAST_DISPARITY = 1 / 2000
"""Normalised disparity: that of a point at 2000 baselines. Smaller ones do not determine the distance."""
TERMS: tuple[str, ...] = (
    "both_k1", "both_k2", "offset_x", "pitch", "yaw", "roll", "focal", "k1", "k2", "p1", "p2", "q1", "q2", "ahead",
    "lag", "offset_y", "down",
)  # fmt: skip
"""The corrections in their order.

- both_k1, both_k2: radial distortion of both cameras; all others are those of the right camera alone.
- offset_x: shift to the right in the middle of the image [rad].
- pitch, yaw, roll: rotation about its own x, y, z axes [rad].
- focal: relative change of the focal length.
- k1, k2: radial distortion; p1, p2: decentring; q1, q2: growth of the decentring with r^2.
- ahead: displacement along the optical axis, relative to the baseline.
- lag: delay of the shutter [s].
- offset_y: shift down in the middle of the image [rad].
- down: displacement down, relative to the baseline.

The focal length of both cameras is not one of them: a straight drive determines it less well than a calibration board,
and all lengths would depend on it.
"""
PAIR = len(TERMS)
"""Number of corrections."""
BOTH_K1, BOTH_K2, OFFSET_X, PITCH, YAW, ROLL, FOCAL, K1, K2, P1, P2, Q1, Q2, AHEAD, LAG = range(PAIR - 2)
OFFSET_Y, DOWN = PAIR - 2, PAIR - 1
BOTH = OFFSET_X
"""Number of corrections of both cameras, which are the first ones. See `without_lens`."""
COLUMNS = OFFSET_Y
"""Number of corrections that change columns (x), which are the first ones. Rows (y) depend on all."""
INVERSIONS = 4
"""Number of fixed-point iterations that invert the distortion; each reduces the error to a few hundredths."""
LEAST_S = 1e-5
"""Least step [s] of the difference quotient by time."""


def by_column(seen: Array, disparity: Array, late: Array | None = None) -> Array:
    """Returns the derivatives (N, COLUMNS) of x in the right image by each correction; 0 where a position is NaN.

    `seen` (N, 2): ideal normalised positions in the right image. `disparity` (N,), normalised. `late` (N, 2):
    derivatives of x and y by the lag, see `drift`; 0 by default.
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
    """Fills row n of `by_column`, which contains zeros before."""
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
    """Returns the derivatives (N, E) of y in the right image, minus y in the left one, by each correction.

    Arguments are as in `by_column`.
    """
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
    """Returns the corrections (3,) of the left lens: relative change of the focal length (0), k1, k2."""
    return np.array([0.0, extra[BOTH_K1], extra[BOTH_K2]])


def without_lens(seen: Array, extra: Array) -> Array:
    """Removes the distortion of both cameras from normalised positions (N, 2) in the left image; copies other columns.

    Inverts seen = x (1 + both_k1 r^2 + both_k2 r^4).
    """
    out = np.array(seen, np.float64, order="C")
    _remove_lens(out, float(extra[BOTH_K1]), float(extra[BOTH_K2]))
    return out


@kernel()
def _remove_lens(places, k1, k2):
    for n in range(len(places)):
        places[n, 0], places[n, 1] = lens_removed(places[n, 0], places[n, 1], k1, k2)


@part
def lens_removed(u, v, k1, k2):
    """Returns `without_lens` of one position."""
    x, y = u, v
    for _ in range(INVERSIONS):
        square = x * x + y * y
        stretch = 1 + square * (k1 + square * k2)
        x, y = u / stretch, v / stretch
    return x, y


def without_errors(seen: Array, extra: Array, late: Array | None = None) -> Array:
    """Returns the observations (N, 3) that a perfect pair would have made; NaN stays NaN.

    `seen` (N, 3): x, y in the left image and x in the right one, normalised. `late` is as in `by_column`.
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
    """Fills row n of `by_column`, zeros before, at the position that a perfect right camera would observe; returns its
    x.

    x, y: corrected position in the left image; `right`: observed x in the right one.
    """
    ideal = right
    for _ in range(INVERSIONS):
        fill_column(out, n, ideal, y, x - ideal, late)
        wrong = 0.0
        for i in range(COLUMNS):
            wrong += out[n, i] * extra[i]
        ideal = right - wrong
    return ideal


def drift(xyz: Array, rates: Array, lag: float, baseline: float) -> Array:
    """Returns the derivatives (N, 2) of normalised x and y in the right image by the lag [1/s].

    `xyz` (N, 3): points in the left camera [m]. `rates` (N, 6), or (1, 6) for all points: left twist of
    camera_from_world per second (rho [m/s], phi [rad/s]). The motion in the image is not quite linear, so this is the
    difference quotient over `lag` [s].
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
    """Returns `drift` of one point by the rate of row n."""
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
    """Returns the evidence on the corrections from row differences between the two images.

    `lower` (N,): y in the right image minus y in the left one, normalised; NaN if unknown. `factors` (N, E): the result
    of `by_row`. `extra` (E,) and `covariance` (E, E): the corrections' estimate without this evidence. robust loss of
    scale `scale`. Points and poses are held: they hardly depend on the right rows, as the left ones determine them.
    """
    good = np.isfinite(lower) & np.isfinite(factors).all(1)
    design, rows, ids = factors[good], lower[good], ids[good]
    if not len(rows):
        return Evidence(design, rows, rows, ids)
    free, root = np.diag(covariance) > 0, np.ones(len(rows))
    known, error = np.linalg.inv(covariance[np.ix_(free, free)]), rows - design @ extra
    start, part, middle = error, design[:, free], len(rows) // 2
    for _ in range(iterations):
        # The loss is as wide as the remaining errors.
        wide = max(scale, 1.5 * float(np.partition(np.abs(error), middle)[middle]))
        weight = 1 / (wide**2 + error**2)
        weighted, root = part.T * weight, np.sqrt(weight)
        inverse = np.linalg.inv(known + weighted @ part)
        error = start - part @ (inverse @ (weighted @ start))
    drawn = np.einsum("ni,in->n", part @ inverse, weighted)
    return Evidence(design * root[:, None], rows * root, -error * root / (1 - drawn), ids)
