"""Interpolates poses (section 6.3, step 1): positions linearly or by B-spline, rotations spherically linearly."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from ispom.solvers.trajectory.cubic import cubic_at
from ispom.types import Trajectory

Interpolation = Literal["linear", "bspline"]


def interpolate(trajectory: Trajectory, times_ns: NDArray[np.int64], kind: Interpolation) -> Trajectory:
    """Returns the poses at times (M,) [ns]; outside the trajectory's span, those of the nearest end.

    The B-spline is the cubic through every position (of lower degree with fewer than four poses).
    Raises ValueError for an empty trajectory.
    """
    if not len(trajectory):
        raise ValueError("an empty trajectory cannot be interpolated")
    times = np.clip(np.asarray(times_ns, np.int64), trajectory.times_ns[0], trajectory.times_ns[-1])
    if len(trajectory) == 1:
        return Trajectory(
            np.asarray(times_ns, np.int64),
            np.repeat(trajectory.rotations, len(times), 0),
            np.repeat(trajectory.translations, len(times), 0),
            trajectory.frame,
        )
    start = trajectory.times_ns[0]
    knots_s, asked_s = (trajectory.times_ns - start) * 1e-9, (times - start) * 1e-9
    if kind == "bspline":
        translations = cubic_at(knots_s, trajectory.translations, asked_s)
    else:
        translations = np.stack([np.interp(asked_s, knots_s, axis) for axis in trajectory.translations.T], axis=1)
    rotations = Slerp(knots_s, Rotation.from_matrix(trajectory.rotations))(asked_s).as_matrix()
    return Trajectory(np.asarray(times_ns, np.int64), rotations, translations, trajectory.frame)
