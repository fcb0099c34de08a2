"""What is wrong with the right camera of a rectified pair: turned, another focal length and lens, a late shutter.

All errors are small, so each moves what the right camera sees by its share of a fixed pattern over the image (first
order; Brown 1971 for the lens, signs as in OpenCV). A turn about x or y and a shift of the principal point differ in
the second order only. So their sum is one unknown, the offset in the middle of the image, which is well known; the turn
is the other, and stands for what it does beside that. Columns and rows tell a turn from decentring.
"""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array

TERMS: tuple[str, ...] = (
    "offset_x", "offset_y", "pitch", "yaw", "roll", "focal", "k1", "k2", "p1", "p2", "q1", "q2", "down", "ahead",
    "lag",
)  # fmt: skip
"""The unknowns in their order: right and down in the middle of the image [rad]; how the camera is turned about its own
x, y, z axes [rad]; longer focal length, as a share; radial distortion, decentring, and what it grows by with r^2;
how much lower and farther ahead it sits, over the baseline; how late its shutter is [s]."""
PAIR = len(TERMS)
OFFSET_X, OFFSET_Y, PITCH, YAW, ROLL, FOCAL, K1, K2, P1, P2, Q1, Q2, DOWN, AHEAD, LAG = range(PAIR)
LEAST_S = 1e-5
"""Steps of the difference quotient are not smaller."""


def by_column(seen: Array, disparity: Array, late: Array | None = None) -> Array:
    """(N, E) by how much x in the right image grows with each unknown, at places (N, 2), normalised.

    `late` (N, 2): how x and y grow with the lag, see `drift`; without it the lag does nothing. 0 where a place is NaN.
    """
    x, y = seen.T
    square, decentring = x * x + y * y, 2 * x * y
    out = np.zeros((PAIR, len(x)))
    out[OFFSET_X] = 1.0
    out[PITCH], out[YAW], out[ROLL], out[FOCAL] = x * y, -x * x, y, x
    out[K1], out[K2] = square * x, square * square * x
    out[P1], out[P2] = decentring, square + 2 * x * x
    out[Q1], out[Q2] = square * out[P1], square * out[P2]
    out[AHEAD] = x * disparity
    if late is not None:
        out[LAG] = late[:, 0]
    out[:, np.isnan(x)] = 0.0
    return np.ascontiguousarray(out.T)


def by_row(seen: Array, disparity: Array, late: Array) -> Array:
    """(N, E) the same of y."""
    x, y = seen.T
    square = x * x + y * y
    out = np.zeros((PAIR, len(x)))
    out[OFFSET_Y] = 1.0
    out[PITCH], out[YAW], out[ROLL], out[FOCAL] = y * y, -x * y, -x, y
    out[K1], out[K2] = square * y, square * square * y
    out[P1], out[P2] = square + 2 * y * y, 2 * x * y
    out[Q1], out[Q2] = square * out[P1], square * out[P2]
    out[DOWN], out[AHEAD], out[LAG] = -disparity, y * disparity, late[:, 1]
    return np.ascontiguousarray(out.T)


def drift(xyz: Array, rates: Array, lag: float, baseline: float) -> Array:
    """(N, 2) how much x and y in the right image grow per second of lag, of points (N, 3) of the left camera.

    `rates` (N, 6): change of camera_from_world (rho [m/s], phi [rad/s]; left). About `lag`: it is not quite linear.
    """
    z = np.maximum(xyz[:, 2], 1e-6)[:, None]
    right = xyz[:, :2] - (baseline, 0.0)
    step = lag if abs(lag) > LEAST_S else LEAST_S
    turn, x, y = rates[:, 3:].T, xyz[:, 0], xyz[:, 1]
    across = turn[1] * xyz[:, 2] - turn[2] * y, turn[2] * x - turn[0] * xyz[:, 2], turn[0] * y - turn[1] * x
    change = rates[:, :3] + np.stack(across, axis=1)
    later = (right + step * change[:, :2]) / np.maximum(z + step * change[:, 2:], 0.5 * z)
    return (later - right / z) / step


def row_evidence(
    factors: Array, lower: Array, extra: Array, covariance: Array, scale: float, iterations: int = 5
) -> tuple[Array, Array]:
    """What points say that lie `lower` (N,) in the right image than in the left one, normalised, NaN where unknown.

    As for Prior.with_evidence: factors (M, E) and rows (M,) in deviations, M known ones. `factors` (N, E) as of
    `by_row`, `extra` and `covariance` what is known without them; Cauchy loss of scale `scale`. Rows have next to
    nothing to say of points and poses, beside the left image's rows from which they are found.
    """
    good = np.isfinite(lower) & np.isfinite(factors).all(1)
    design, rows = factors[good], lower[good]
    if not len(rows):
        return design, rows
    free, root = np.diag(covariance) > 0, np.ones(len(rows))
    known, error = np.linalg.inv(covariance[np.ix_(free, free)]), rows - design @ extra
    start, part, middle = error, design[:, free], len(rows) // 2
    for _ in range(iterations):
        # As wide as the errors still are.
        wide = max(scale, 1.5 * float(np.partition(np.abs(error), middle)[middle]))
        weight = 1 / (wide**2 + error**2)
        weighted, root = part.T * weight, np.sqrt(weight)
        error = start - part @ np.linalg.solve(known + weighted @ part, weighted @ start)
    return design * root[:, None], rows * root
