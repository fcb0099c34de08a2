"""The errors in `metrics.json`, and errors between stereo frames, which the integration is to reduce (Table 4)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ispom.evaluation.relative_error import kitti_errors, rpe
from ispom.evaluation.scale import step_scale
from ispom.evaluation.trajectory_error import alignment_of, error_against_truth, rms
from ispom.geometry import Array
from ispom.solvers.trajectory.interpolation import interpolate
from ispom.types import Rig, Trajectory


def between_stereo_rmse_m(estimate: Trajectory, stereo: Trajectory, truth: Trajectory) -> float | None:
    """Returns the RMS position error of the estimate's poses relative to the stereo pose that opens their segment.

    All are world_from_rig; estimate and stereo share a world, truth may have another. Poses without truth at their
    time, or outside the stereo poses' span, are ignored. None where none is left.
    """
    times_ns, opening = _segments(estimate.times_ns, stereo, truth)
    if not len(times_ns):
        return None
    own = _positions_from(stereo, opening, estimate, times_ns)
    true = _positions_from(truth, opening, truth, times_ns)
    return rms(np.linalg.norm(own - true, axis=1))


def spline_between_stereo_rmse_m(estimate: Trajectory, stereo: Trajectory, truth: Trajectory) -> float | None:
    """Returns the error of the stereo poses interpolated by spline: the baseline for `between_stereo_rmse_m`."""
    if len(stereo) < 2:
        return None
    return between_stereo_rmse_m(interpolate(stereo, estimate.times_ns, "bspline"), stereo, truth)


def _segments(times_ns: np.ndarray, stereo: Trajectory, truth: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Returns the times (K,) that are used, and for each the time of the stereo pose that opens its segment."""
    ends = stereo.times_ns[np.isin(stereo.times_ns, truth.times_ns)]
    times_ns = times_ns[np.isin(times_ns, truth.times_ns)]
    if len(ends) < 2:
        return times_ns[:0], times_ns[:0]
    times_ns = times_ns[(times_ns >= ends[0]) & (times_ns <= ends[-1])]
    return times_ns, ends[np.searchsorted(ends, times_ns, side="right") - 1]


def _positions_from(origin: Trajectory, opening_ns: np.ndarray, trajectory: Trajectory, times_ns: np.ndarray) -> Array:
    """Returns positions (K, 3) of a trajectory at times, in the rig frame of `origin` at the opening times."""
    i, j = np.searchsorted(origin.times_ns, opening_ns), np.searchsorted(trajectory.times_ns, times_ns)
    return np.einsum("kji,kj->ki", origin.rotations[i], trajectory.translations[j] - origin.translations[i])


def path_errors(trajectory: Trajectory, truth: Trajectory, rig: Rig, metric: bool) -> dict[str, Any]:
    """Returns errors of world_from_FRAME against world_from_rig, in any worlds; all None with too few poses.

    `metric`: the unit is the metre, and the alignment SE(3). Otherwise it is Sim(3), and the scale drift is added.
    """
    alignment = alignment_of(metric)
    error = error_against_truth(trajectory, truth, rig, alignment)
    if error is None:
        names = ("ate_m", "rpe_m", "rpe_deg", "t_err_percent", "r_err_deg_per_100m")
        return {"aligned": alignment, **dict.fromkeys(names)}
    estimate, reference = error.aligned, error.reference
    rpe_m, rpe_deg = rpe(estimate, reference)
    drift = kitti_errors(estimate, reference)
    figures: dict[str, Any] = {
        "aligned": alignment,
        "ate_m": error.ate_m,
        "rpe_m": rpe_m,
        "rpe_deg": rpe_deg,
        "t_err_percent": drift and drift.t_err_percent,
        "r_err_deg_per_100m": drift and drift.r_err_deg_per_100m,
        "lengths_m": list(drift.lengths_m) if drift else [],
    }
    if not metric:
        scale = step_scale(estimate, reference)
        figures["step_scale_end_over_start"] = scale and scale.end_over_start
        figures["step_scale_along_path"] = list(scale.windows) if scale else []
    return figures


def between_stereo(integrated: Trajectory, stereo: Trajectory, truth: Trajectory) -> dict[str, float | None]:
    """Returns the errors between stereo frames of the integration and of a spline; all poses are world_from_rig."""
    return {
        "between_stereo_rmse_m": between_stereo_rmse_m(integrated, stereo, truth),
        "spline_between_stereo_rmse_m": spline_between_stereo_rmse_m(integrated, stereo, truth),
    }
