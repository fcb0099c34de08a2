"""Perturbations and their effects in words."""

from __future__ import annotations

from collections.abc import Iterable

from ispom.evaluation.sensitivity.perturbation import Perturbation

from ...presentation.texts import Unit, length, length_unit
from .predictor import Prediction
from .rerun import Compared

NAMES = {
    "video_focal_percent": "video focal length {:+g} %",
    "video_centre_x_px": "video principal point x {:+g} px",
    "video_centre_y_px": "video principal point y {:+g} px",
    "pair_focal_percent": "pair focal length {:+g} %",
    "pair_centre_x_px": "pair principal point x {:+g} px",
    "pair_centre_y_px": "pair principal point y {:+g} px",
    "baseline_percent": "baseline {:+g} %",
    "turn_x_deg": "video pitch on the rig {:+g}°",
    "turn_y_deg": "video yaw on the rig {:+g}°",
    "turn_z_deg": "video roll on the rig {:+g}°",
    "shift_x_m": "video place on the rig x {:+g} m",
    "shift_y_m": "video place on the rig y {:+g} m",
    "shift_z_m": "video place on the rig z {:+g} m",
    "clock_ms": "video clock {:+g} ms",
}
"""Names of the fields of a Perturbation, by field."""
UNIT_STEPS = {name: 0.1 if name.endswith("deg") else 0.01 if name.endswith("_m") else 1.0 for name in NAMES}
"""Unit step of each field in the list of all fields."""


def perturbation_text(wrong: Perturbation) -> str:
    """What is wrong, one phrase for each."""
    return ", ".join(NAMES[name].format(value) for name, value in wrong.nonzero.items()) or "nothing changed"


def unit_of(predictions: Iterable[Prediction], outcomes: Iterable[Compared] = ()) -> Unit:
    """The unit of all lengths in a table of predictions and reruns."""
    found = [length for each in predictions for length in (each.shift_m, each.ate_m, each.predicted_ate_m)]
    return length_unit([*found, *(length for each in outcomes for length in (each.shift_m, each.ate_m))])


def cell(value_m: float | None, unit: Unit) -> str:
    """A length in such a table."""
    return "no truth" if value_m is None else length(value_m, unit)
