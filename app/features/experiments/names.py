"""Quantities as people read them, and lines as they are drawn."""

from __future__ import annotations

from dataclasses import dataclass

from ...presentation.colours import METHOD, OTHERS, css
from ...presentation.texts import METRE, Unit
from .plan import Plan

LABELS = {
    "ate_m": "ATE [m]",
    "ate_percent": "ATE [% of path]",
    "t_err_percent": "drift [%]",
    "r_err_deg_per_100m": "drift [deg/100 m]",
    "rpe_m": "RPE [m]",
    "rpe_deg": "RPE [deg]",
    "step_scale_end_over_start": "step scale, end over start",
    "between_stereo_rmse_m": "between stereo, RMSE [m]",
    "spline_between_stereo_rmse_m": "spline between stereo, RMSE [m]",
    "between_over_spline": "between stereo, over spline's",
    "m_per_unit": "metres per unit (sim3)",
    "rate_hz": "poses [Hz]",
    "poses": "poses",
    "located": "exposures located",
    "located_percent": "exposures located [%]",
    "lost": "exposures lost",
    "segments": "segments",
    "path_length_m": "path [m]",
}
COLOURS = tuple(map(css, (*METHOD.values(), *OTHERS)))
DASHES = ("solid", "dashed", "dotted", "dashdot")


def label(quantity: str, unit: Unit = METRE) -> str:
    """With its unit, lengths in that which is given; the key itself for one that is not known here."""
    return LABELS.get(quantity, quantity).replace("[m]", f"[{unit.name}]")


def is_length(quantity: str) -> bool:
    return LABELS.get(quantity, "").endswith("[m]")


@dataclass(frozen=True)
class Style:
    colour: str
    dash: str


def styles(plan: Plan) -> dict[str, Style]:
    """By line, all different up to 56 lines."""
    count = len(COLOURS)
    return {line.name: Style(COLOURS[n % count], DASHES[n // count % len(DASHES)]) for n, line in enumerate(plan.lines)}
