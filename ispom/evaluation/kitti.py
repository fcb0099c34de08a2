"""KITTI odometry's errors (Geiger 2012): mean drift over stretches of fixed length along the true path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.evaluation.relative import motion_errors
from ispom.types import Trajectory

OFFICIAL_LENGTHS_M = (100, 200, 300, 400, 500, 600, 700, 800)
SHORT_LENGTHS_M = (5, 10, 20, 40)


@dataclass(frozen=True)
class KittiErrors:
    """Means over all stretches of all lengths."""

    t_err_percent: float
    r_err_deg_per_100m: float
    lengths_m: tuple[int, ...]
    """The lengths that the path had stretches of."""


def kitti_errors(estimate: Trajectory, reference: Trajectory) -> KittiErrors | None:
    """Over 100 to 800 m from every tenth pose, as KITTI does; on a path below 200 m over 5 to 40 m from every pose.

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
