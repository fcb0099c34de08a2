"""Relative pose error: of the motion over a fixed number of poses."""

from __future__ import annotations

import numpy as np

from ispom.evaluation.ate import rms
from ispom.evaluation.relative import motion_errors
from ispom.types import Trajectory


def rpe(estimate: Trajectory, reference: Trajectory, delta: int = 1) -> tuple[float, float]:
    """Root mean square of translation [m] and rotation [deg] errors over all pairs of poses i, i + delta.

    Both hold associated poses, more than delta of them.
    """
    first = np.arange(len(reference) - delta)
    translation_m, rotation_rad = motion_errors(estimate, reference, first, first + delta)
    return rms(translation_m), rms(np.degrees(rotation_rad))
