"""What `metrics.json` says about one trajectory."""

from __future__ import annotations

from typing import Any

from ispom.evaluation.between_stereo import between_stereo_rmse_m, spline_between_stereo_rmse_m
from ispom.evaluation.kitti import kitti_errors
from ispom.evaluation.rpe import rpe
from ispom.evaluation.step_scale import step_scale
from ispom.evaluation.trajectory_error import alignment_of, error_against_truth
from ispom.types import Rig, Trajectory


def errors(trajectory: Trajectory, truth: Trajectory, rig: Rig, metric: bool) -> dict[str, Any]:
    """Errors of world_from_FRAME against world_from_rig, whose worlds may differ; all None with too few poses.

    `metric` says whether the unit is the metre: it is aligned by a rigid motion then, by a similarity otherwise, and
    how its unit changed is told.
    """
    alignment = alignment_of(metric)
    error = error_against_truth(trajectory, truth, rig, alignment)
    if error is None:
        names = ("ate_m", "rpe_m", "rpe_deg", "t_err_percent", "r_err_deg_per_100m")
        return {"aligned": alignment, **dict.fromkeys(names)}
    estimate, reference = error.aligned, error.reference
    rpe_m, rpe_deg = rpe(estimate, reference)
    drift = kitti_errors(estimate, reference)
    found: dict[str, Any] = {
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
        found["step_scale_end_over_start"] = scale and scale.end_over_start
        found["step_scale_along_path"] = list(scale.windows) if scale else []
    return found


def between_stereo(integrated: Trajectory, stereo: Trajectory, truth: Trajectory) -> dict[str, float | None]:
    """How much better than a spline through the stereo poses the integration is; all are world_from_rig."""
    return {
        "between_stereo_rmse_m": between_stereo_rmse_m(integrated, stereo, truth),
        "spline_between_stereo_rmse_m": spline_between_stereo_rmse_m(integrated, stereo, truth),
    }
