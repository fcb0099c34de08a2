"""The observations of a rig along its spline: the point's position, errors, and derivatives of one observation."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.kernels import kernel, part, read_only
from ispom.numerics.reprojection import gradient_by_point
from ispom.numerics.robust import weighted_information
from ispom.numerics.vectors import cross, dot, matrix, minus, plus, scaled, store, times, times_transposed, vector

RIG = 7
"""Unknowns of the rig: rig_from_video's rotation (in the camera) [rad] and position [m], the clock offset [s]."""
MIN_DEPTH = 1e-4
"""Least depth of a point in a camera, relative to its depth in its anchor; with less, the observation has no weight."""
SQUARE_BEHIND = 1e4
"""Squared error, in squared standard deviations, of such an observation."""
IMAGES = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, -1.0]])
"""Derivatives of x, y and disparity by x, y and the right x."""


class Observed(NamedTuple):
    """Poses of the rig, its cameras, and the arrays of RigObservations and AnchoredPoints."""

    rotations: Array
    """(E, 3, 3) world_from_rig at the exposures."""
    positions: Array
    """(E, 3)."""
    cameras_r: Array
    """(2, 3, 3) rig_from_camera."""
    cameras_t: Array
    """(2, 3)."""
    baseline: float
    exposures: NDArray[np.int64]
    cameras: NDArray[np.int64]
    owners: NDArray[np.int64]
    seen: Array
    inverse_sigma: Array
    anchors_r: Array
    anchors_t: Array
    points: Array

    @classmethod
    def of(cls, *values: Any) -> Observed:
        """Makes all arrays read-only and contiguous, so that kernels are compiled for one signature only."""
        arrays: list[Any] = [read_only(value) if isinstance(value, np.ndarray) else value for value in values]
        return cls(*arrays)


class Rows(NamedTuple):
    """Errors of one observation in standard deviations, and their derivatives: x, y and, for a pair, the disparity."""

    errors: Array
    """(3,)."""
    by_camera: Array
    """(3, 3) derivatives by the point's position in the camera, times its inverse depth as in `placed`."""
    by_rig: Array
    """(3, 3) derivatives by that in the rig."""
    by_pose: Array
    """(3, 6) derivatives by the rig's rotation (in the rig) and position (in the world)."""
    by_point: Array
    """(3, 3) derivatives by the point's values."""


@kernel()
def empty_rows():
    return Rows(np.empty(3), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 6)), np.empty((3, 3)))


@kernel()
def squared_errors(observed):
    """Returns the squared reprojection errors (O,), in squared standard deviations."""
    out = np.empty(len(observed.exposures))
    for o in range(len(out)):
        out[o] = _squared_error(observed, o)
    return out


@part
def _squared_error(observed, o):
    _, camera = placed(observed, o)
    if camera[2] <= MIN_DEPTH:
        return SQUARE_BEHIND
    _, _, _, errors = image_errors(observed, o, camera)
    return dot(errors, errors)


@part
def placed(observed, o):
    """Returns the position of observation o's point, times its inverse depth (finite at infinity), in rig and
    camera."""
    e, c, m = observed.exposures[o], observed.cameras[o], observed.owners[o]
    a, b, rho = vector(observed.points, m)
    from_rig = minus(vector(observed.anchors_t, m), vector(observed.positions, e))
    world = plus(times(matrix(observed.anchors_r, m), (a, b, 1.0)), scaled(rho, from_rig))
    rig = times_transposed(matrix(observed.rotations, e), world)
    from_camera = minus(rig, scaled(rho, vector(observed.cameras_t, c)))
    return rig, times_transposed(matrix(observed.cameras_r, c), from_camera)


@part
def image_errors(observed, o, camera):
    """Returns x, y, right x of a point before its camera, and the errors (3); that of an unknown disparity is 0."""
    iz, shift = 1.0 / camera[2], observed.baseline * observed.points[observed.owners[o], 2]
    x, y, right = camera[0] * iz, camera[1] * iz, (camera[0] - shift) * iz
    seen, per = vector(observed.seen, o), vector(observed.inverse_sigma, o)
    of_disparity = (shift * iz - seen[2]) * per[2] if per[2] > 0.0 else 0.0
    return x, y, right, ((x - seen[0]) * per[0], (y - seen[1]) * per[1], of_disparity)


@part
def linearise(rows, observed, o, rig, camera):
    """Fills the rows of an observation of a point before its camera; returns their number, 2 or 3."""
    x, y, right, errors = image_errors(observed, o, camera)
    count, iz = 3 if observed.inverse_sigma[o, 2] > 0.0 else 2, 1.0 / camera[2]
    for i in range(count):
        rows.errors[i], per_z = errors[i], observed.inverse_sigma[o, i] * iz
        by_x, by_y, by_right = vector(IMAGES, i)
        by_camera = gradient_by_point(x, y, right, per_z, by_x, by_y, by_right)
        # The right x depends on the inverse depth through the position in the left camera, and through the baseline.
        _fill_row(rows, i, observed, o, rig, by_camera, -by_right * per_z * observed.baseline)
    return count


@part
def _fill_row(rows, i, observed, o, rig, by_camera, by_depth):
    """Fills row i from an error's derivatives by the position in the camera and, at a fixed position, by the inverse
    depth."""
    e, c, m = observed.exposures[o], observed.cameras[o], observed.owners[o]
    by_rig = times(matrix(observed.cameras_r, c), by_camera)
    by_world = times(matrix(observed.rotations, e), by_rig)
    a, b, _ = times_transposed(matrix(observed.anchors_r, m), by_world)
    apart = dot(by_world, minus(vector(observed.anchors_t, m), vector(observed.positions, e)))
    store(rows.by_camera, i, by_camera)
    store(rows.by_rig, i, by_rig)
    store(rows.by_point, i, (a, b, apart - dot(by_rig, vector(observed.cameras_t, c)) + by_depth))
    turn, shift = cross(by_rig, rig), scaled(-observed.points[m, 2], by_world)
    rows.by_pose[i, 0], rows.by_pose[i, 1], rows.by_pose[i, 2] = turn
    rows.by_pose[i, 3], rows.by_pose[i, 4], rows.by_pose[i, 5] = shift


@part
def robust_weight(rows, count, loss):
    square = 0.0
    for i in range(count):
        square += rows.errors[i] * rows.errors[i]
    return loss * loss * weighted_information(square, 1.0 / (loss * loss))


def slope(weights: Array, images: int) -> float:
    """Returns the mean derivative of observations' scores by their errors, relative to the mean of `weights` (O,).

    It is less than 1, as the loss flattens. An observation has `images` errors of one variance.
    A score w e changes by w - 2 w^2 e_i^2 / c^2 with e_i, and w |e|^2 / c^2 is 1 - w.
    """
    first, second = float(weights.sum()), float((weights**2).sum())
    return 1.0 - 2 * (first - second) / (images * first) if first > 0 else 1.0
