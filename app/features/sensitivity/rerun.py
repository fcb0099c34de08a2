"""A run again with a wrong calibration, and how it compares with what was predicted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ispom.evaluation.sensitivity.effect import shift_m
from ispom.evaluation.sensitivity.perturbation import Perturbation
from ispom.methods import method as registered
from ispom.types import Trajectory

from .predictor import Prediction, Predictor

CLOSE = 0.3
"""A prediction that differs by this share from the rerun held."""


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
        """The predicted shift over that of the rerun."""
        return self.prediction.shift_m / self.shift_m if self.shift_m > 0 else float("inf")

    @property
    def agrees(self) -> bool:
        return abs(self.ratio - 1) <= CLOSE


def compared(
    predictor: Predictor, predictions: tuple[Prediction, ...], again: Mapping[str, Trajectory], wrong: Perturbation
) -> tuple[Compared, ...]:
    """Of all methods that both have; `again` are the trajectories of the rerun, each in its own world."""
    found = []
    for prediction in predictions:
        method = prediction.method
        if (rerun := again.get(method)) is None or not len(rerun):
            continue
        run, metric = predictor.ran.trajectories[method], registered(method).unit == "metric"
        rerun = at_own_stamps(method, rerun, wrong)
        if not len(np.intersect1d(run.times_ns, rerun.times_ns)):
            continue
        unit_m = 1.0 if metric else predictor.ran.units_m.get(method, 1.0)
        shift = unit_m * shift_m(run, rerun, "none" if metric else "sim3")
        found.append(Compared(prediction, shift, predictor.ate_m(method, rerun)))
    return tuple(found)


def at_own_stamps(method: str, rerun: Trajectory, wrong: Perturbation) -> Trajectory:
    """With the stamps of the run: those of the video are later in the rerun."""
    late_ns = round(wrong.clock_ms * 1e6) if "video" in registered(method).sensors else 0
    return replace(rerun, times_ns=rerun.times_ns - late_ns)
