"""Errors of motions between two poses of a trajectory, on which RPE and KITTI's errors are built."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, rotation_angle_rad
from ispom.types import Trajectory


def motion_errors(
    estimate: Trajectory, reference: Trajectory, first: NDArray[np.intp], last: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Of the motions first_from_last (K): translation errors (K,) [m] and rotation errors (K,) [rad]."""
    true_r, true_t = _motions(reference, first, last)
    own_r, own_t = _motions(estimate, first, last)
    back = np.swapaxes(true_r, 1, 2)
    errors = np.einsum("kij,kj->ki", back, own_t - true_t)
    return np.linalg.norm(errors, axis=1), rotation_angle_rad(back @ own_r)


def _motions(trajectory: Trajectory, first: NDArray[np.intp], last: NDArray[np.intp]) -> tuple[Array, Array]:
    """first_from_last rotations (K, 3, 3) and translations (K, 3)."""
    back = np.swapaxes(trajectory.rotations[first], 1, 2)
    steps = trajectory.translations[last] - trajectory.translations[first]
    return back @ trajectory.rotations[last], np.einsum("kij,kj->ki", back, steps)
