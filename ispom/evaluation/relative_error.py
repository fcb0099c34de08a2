"""Errors of the motion between two poses: the relative pose error (RPE), and KITTI's drift."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.trajectory_error import rms
from ispom.geometry import Array, rotation_angle_rad
from ispom.types import Trajectory


def motion_errors(
    estimate: Trajectory, reference: Trajectory, first: NDArray[np.intp], last: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Returns translation errors (K,) [m] and rotation errors (K,) [rad] of the motions first_from_last."""
    true_r, true_t = _motions(reference, first, last)
    own_r, own_t = _motions(estimate, first, last)
    back = np.swapaxes(true_r, 1, 2)
    errors = np.einsum("kij,kj->ki", back, own_t - true_t)
    return np.linalg.norm(errors, axis=1), rotation_angle_rad(back @ own_r)


def _motions(trajectory: Trajectory, first: NDArray[np.intp], last: NDArray[np.intp]) -> tuple[Array, Array]:
    """Returns rotations (K, 3, 3) and translations (K, 3) of first_from_last."""
    back = np.swapaxes(trajectory.rotations[first], 1, 2)
    steps = trajectory.translations[last] - trajectory.translations[first]
    return back @ trajectory.rotations[last], np.einsum("kij,kj->ki", back, steps)


def rpe(estimate: Trajectory, reference: Trajectory, delta: int = 1) -> tuple[float, float]:
    """Returns the root mean square translation [m] and rotation [deg] errors over all pairs of poses i, i + delta.

    Both hold associated poses, more than delta of them.
    """
    first = np.arange(len(reference) - delta)
    translation_m, rotation_rad = motion_errors(estimate, reference, first, first + delta)
    return rms(translation_m), rms(np.degrees(rotation_rad))


OFFICIAL_LENGTHS_M = (100, 200, 300, 400, 500, 600, 700, 800)
"""Lengths of KITTI's benchmark (Geiger 2012)."""
SHORT_LENGTHS_M = (5, 10, 20, 40)
"""Lengths for paths below 200 m, into which hardly any of the benchmark's fit."""


@dataclass(frozen=True)
class KittiErrors:
    """KITTI odometry's errors (Geiger 2012): mean drift over all stretches of fixed length along the true path."""

    t_err_percent: float
    r_err_deg_per_100m: float
    lengths_m: tuple[int, ...]
    """The lengths that fit into the path."""


def kitti_errors(estimate: Trajectory, reference: Trajectory) -> KittiErrors | None:
    """Measures drift over 100 to 800 m from every tenth pose, as KITTI does; below 200 m, over 5 to 40 m from all.

    Both hold associated poses. None where the path is shorter than the shortest length.
    """
    travelled = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(reference.translations, axis=0), axis=1))])
    official = travelled[-1] >= 2 * OFFICIAL_LENGTHS_M[0]
    starts = np.arange(0, len(reference), 10 if official else 1)
    translations, rotations, used = [], [], []
    for length in OFFICIAL_LENGTHS_M if official else SHORT_LENGTHS_M:
        ends = np.searchsorted(travelled, travelled[starts] + length, side="right")
        inside = ends < len(reference)
        if inside.any():
            translation_m, rotation_rad = motion_errors(estimate, reference, starts[inside], ends[inside])
            translations.append(100 * translation_m / length)
            rotations.append(100 * np.degrees(rotation_rad) / length)
            used.append(length)
    if not used:
        return None
    return KittiErrors(float(np.concatenate(translations).mean()), float(np.concatenate(rotations).mean()), tuple(used))
