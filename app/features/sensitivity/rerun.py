"""A run again with a wrong calibration, and how it compares with what was predicted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ispom.evaluation.sensitivity.effect import shift_m
from ispom.evaluation.sensitivity.perturbation import Perturbation
from ispom.evaluation.trajectory_error import alignment
from ispom.methods import method as registered
from ispom.types import Rig, Trajectory

from ...engine.run_folder.results import in_frame
from .predictor import Prediction, Predictor

CLOSE = 0.3
"""A prediction that differs by this share from the rerun held."""
ROUNDING_M = 1e-6
"""Shifts below this are none: a run's folder has its positions rounded."""


@dataclass(frozen=True, eq=False)
class Compared:
    """A prediction and what a rerun gave."""

    prediction: Prediction
    shift_m: float
    """Root mean square distance of the rerun from the run."""
    ate_m: float | None
    """ATE of the rerun, as that of the run."""

    @property
    def ratio(self) -> float:
        """The predicted shift over that of the rerun; 1 where neither moves."""
        if max(self.prediction.shift_m, self.shift_m) < ROUNDING_M:
            return 1.0
        return self.prediction.shift_m / self.shift_m if self.shift_m > 0 else float("inf")

    @property
    def agrees(self) -> bool:
        return abs(self.ratio - 1) <= CLOSE


def compared(
    predictor: Predictor, predictions: tuple[Prediction, ...], again: Mapping[str, Trajectory], wrong: Perturbation
) -> tuple[Compared, ...]:
    """Of all methods that both have; `again` are the trajectories of the rerun, each in its own world and frame."""
    found = []
    for prediction in predictions:
        method = prediction.method
        if (rerun := again.get(method)) is None or not len(rerun):
            continue
        run, metric = predictor.ran.trajectories[method], registered(method).unit == "metric"
        rerun = at_own_stamps(method, rerun, wrong)
        if not len(np.intersect1d(run.times_ns, rerun.times_ns)):
            continue
        unit_m = predictor.ran.units_m.get(method, 1.0 if metric else None)
        rerun = of_same_point(rerun, run, predictor.ran.rig, unit_m, metric)
        shift = (unit_m or 1.0) * shift_m(run, rerun, "none" if metric else "sim3")
        found.append(Compared(prediction, shift, predictor.ate_m(method, rerun)))
    return tuple(found)


def of_same_point(rerun: Trajectory, run: Trajectory, rig: Rig, unit_m: float | None, metric: bool) -> Trajectory:
    """Returns the rerun's path of the frame that the run's is of: a run's folder has all paths of one frame.

    Where a wrong calibration leaves a camera's path as it is, nothing moves: `rig` is the one without the error, with
    the lever arm that the run's folder was written with, in the rerun's unit. `unit_m` is that of the run [m], None
    where it is unknown.
    """
    if rerun.frame == run.frame:
        return rerun
    if unit_m is not None and not metric:
        times_ns = np.intersect1d(run.times_ns, rerun.times_ns)
        one, two = (t.select(np.searchsorted(t.times_ns, times_ns)) for t in (run, rerun))
        unit_m *= alignment(two, in_frame(one, rig, rerun.frame, unit_m), "sim3").scale
    return in_frame(rerun, rig, run.frame, unit_m)


def at_own_stamps(method: str, rerun: Trajectory, wrong: Perturbation) -> Trajectory:
    """With the stamps of the run: those of the video are later in the rerun."""
    late_ns = round(wrong.clock_ms * 1e6) if "video" in registered(method).sensors else 0
    return replace(rerun, times_ns=rerun.times_ns - late_ns)
