"""The contribution of a wrong or drifting scale to the error of a trajectory. It needs no rerun."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.evaluation.scale import step_scale
from ispom.evaluation.trajectory_error import TrajectoryError


def scale_part_m2(error: TrajectoryError) -> float | None:
    """Returns by how much the squared error falls with the right scale [m^2]; None where the path is too short.

    Of a metric method it is the scale of the whole path (SE(3) against Sim(3)), else its drift along the path.
    """
    right = _of_path(error) if error.alignment == "se3" else _of_steps(error)
    return None if right is None else error.ate_m**2 - right.ate_m**2


def _of_path(error: TrajectoryError) -> TrajectoryError:
    return replace(error, alignment="sim3")


def _of_steps(error: TrajectoryError) -> TrajectoryError | None:
    """Returns the error of the path with each step divided by its scale, by the chords of the path."""
    estimate = error.estimate
    scale = step_scale(estimate, error.reference)
    if scale is None or min(scale.windows) <= 0:
        return None
    begin_ns = estimate.times_ns[0]
    times_s = (estimate.times_ns - begin_ns) * 1e-9
    middles_s = (np.array(scale.middles_ns) - begin_ns) * 1e-9
    local = np.exp(np.interp((times_s[1:] + times_s[:-1]) / 2, middles_s, np.log(scale.windows)))
    steps = np.diff(estimate.translations, axis=0) / local[:, None]
    positions = estimate.translations[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    return replace(error, estimate=replace(estimate, translations=positions))
