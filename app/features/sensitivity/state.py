"""What an error of the calibration would do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ispom.evaluation.sensitivity.perturbation import Perturbation

from ...session.state import FeatureState, State
from .predictor import Prediction
from .rerun import Compared


@dataclass(frozen=True, eq=False)
class Effect:
    """What is shown of a wrong calibration."""

    wrong: Perturbation
    computed: int
    """Frames of the run that the prediction is made of."""
    predictions: tuple[Prediction, ...]
    rerun: bool = False
    """Whether a branch runs, or ran, with it."""
    outcomes: tuple[Compared, ...] = ()
    """What came out there; empty until it has ended."""


@dataclass(frozen=True)
class CalibrationEffect(FeatureState):
    effect: Effect | None = None

    def page(self, state: State) -> dict[str, Any]:
        """What is wrong with the calibration, and how far that moves each method: predicted, and in the rerun [m]."""
        effect = self.effect
        if effect is None:
            return {"effect": None}
        predicted = {each.method: each.shift_m for each in effect.predictions}
        found = {each.prediction.method: each.shift_m for each in effect.outcomes}
        return {"effect": {"wrong": effect.wrong.said, "predicted": predicted, "rerun": found}}
