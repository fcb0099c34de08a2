"""What lessons compute from runs: functions of a run and names, by the name that a lesson's file uses."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.methods import method as registered

from ..ran import Ran
from . import geometry, paths

NUMBERS: Mapping[str, Callable[..., float]] = {
    f.__name__: f
    for f in (
        paths.ate_m,
        paths.ate_percent,
        paths.rpe_m,
        paths.error_at_end_m,
        paths.metres_per_unit,
        paths.step_scale_end,
        paths.direction_deg,
        paths.length_m,
        paths.speed_m_per_s,
        paths.poses_per_s,
        paths.located_percent,
        paths.between_stereo_m,
        paths.spline_between_stereo_m,
        paths.median,
        paths.largest,
        paths.total,
        paths.last,
        paths.holds_percent,
        geometry.focal_times_baseline,
        geometry.doubled_world_px,
        geometry.printed_over_vector,
        geometry.stage_gap_m,
        geometry.stage_turn_deg,
        geometry.stage_orientation_deg,
        geometry.image_motion_px,
        geometry.clock_ms,
        geometry.points,
    )
}
CURVES: Mapping[str, Callable[..., tuple[Array, Array]]] = {
    f.__name__: f for f in (paths.step_scale_curve, paths.error_curve, paths.quantity_curve)
}


def require_arguments(where: str, function: Callable[..., object], arguments: Sequence[str]) -> None:
    """InputError unless these are what the function takes after the run, with methods that there are."""
    names = list(inspect.signature(function).parameters)[1:]
    if len(names) != len(arguments):
        raise InputError(f"{where} takes (RUN{''.join(f', {name.upper()}' for name in names)}): correct it")
    for name, argument in zip(names, arguments, strict=True):
        if name in ("method", "stereo"):
            registered(argument)


def number(ran: Ran, function: str, arguments: Sequence[str]) -> float:
    """InputError where the run does not have what it takes."""
    return float(NUMBERS[function](ran, *arguments))


def curve(ran: Ran, function: str, arguments: Sequence[str]) -> tuple[Array, Array]:
    """x and y (N,), x ascending; InputError as `number`."""
    return CURVES[function](ran, *arguments)
