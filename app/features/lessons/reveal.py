"""What the runs of a step show: its values, and which answer is right."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.types import Tracks

from ...engine.conditions.evaluate import holds, number
from ...engine.conditions.parser import Expression
from ...engine.history.history import Records
from ...engine.history.quantities import NO_ROW, Row
from ...engine.inspection.sightings import seen_before
from . import facts
from .lesson import OWN, Ask, Choose, Draw, Fact, Number, Point, Step, right_tracks
from .ran import Ran


@dataclass(frozen=True, eq=False)
class Revealed:
    """Everything in it comes from the runs."""

    values: Mapping[str, float]
    right: frozenset[int] = frozenset()
    """Of a choice the places of the options that hold, of a picture the ids of the right tracks."""
    curve: tuple[Array, Array] | None = None
    """x and y (N,)."""
    broken: tuple[str, ...] = ()
    """The claims of the text that do not hold in these runs."""


def revealed(step: Step, runs: Mapping[str, Ran]) -> Revealed:
    """Of the step's runs by name. InputError where they do not have what it computes."""
    own = runs[OWN]
    row = dict(own.series.row(own.count - 1, own.series.quantities.values()))
    values: dict[str, float] = {}
    for name, rule in step.values.items():
        values[name] = _value(name, rule, runs, row)
        row[""] = {**row.get("", {}), **values}
    broken = tuple(claim.text for claim in step.claims if not holds(claim, row, NO_ROW))
    match step.ask:
        case Choose(options):
            right = frozenset(i for i, option in enumerate(options) if holds(option.holds, row, NO_ROW))
            return Revealed(values, right, None, broken)
        case Number():
            return Revealed(values, broken=broken)
        case Point(camera, condition):
            tracks = pictured(own.records, step.at, camera)[1]
            right = tracks.ids[right_tracks(tracks, own.sequence.rig, condition)]
            return Revealed(values, frozenset(right.tolist()), None, broken)
        case Draw(curve):
            return Revealed(values, curve=facts.curve(runs[curve.run], curve.function, curve.arguments), broken=broken)


def pictured(records: Records, at: int, camera: str) -> tuple[int, Tracks]:
    """The frame of a camera's latest picture up to `at`, and the tracks in it. InputError where there is none."""
    found = next(seen_before(records, at, "", camera), None)
    if found is None:
        raise InputError(f"up to frame {at} no method follows a track in the {camera} camera: ask later in the run")
    return found.index, found.tracks


def _value(name: str, rule: Fact | Expression, runs: Mapping[str, Ran], row: Row) -> float:
    if isinstance(rule, Fact):
        found = facts.number(runs[rule.run], rule.function, rule.arguments)
    else:
        found = number(rule, row, NO_ROW)
    if found is None or not math.isfinite(found):
        raise InputError(f"{name} has no value in this run, so that nothing can be revealed: end the lesson here")
    return found


def sampled(curve: tuple[Array, Array], x: Array) -> NDArray[np.float64]:
    """The curve at x (M,), ascending: straight between its points, beyond its ends as there."""
    return np.interp(x, *curve)


SAMPLES = 24
"""Number of points of a drawn curve, evenly over its range of x."""
Answer = int | float | tuple[float, ...]
"""The place of an option or the id of a track, a number, or the (SAMPLES,) heights of a curve."""


def accepted(ask: Ask, answer: Any, tracks: Sequence[int] = ()) -> Answer | None:
    """What somebody sent, where it is an answer to this; else None. `tracks` are the ids of those in the picture."""
    if isinstance(answer, bool):
        return None
    match ask:
        case Choose(options):
            return answer if isinstance(answer, int) and 0 <= answer < len(options) else None
        case Point():
            return answer if isinstance(answer, int) and answer in tracks else None
        case Number():
            return float(answer) if isinstance(answer, int | float) and math.isfinite(answer) else None
        case Draw():
            good = isinstance(answer, list) and len(answer) == SAMPLES and all(map(_is_height, answer))
            return tuple(map(float, answer)) if good else None


def _is_height(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def is_right(ask: Ask, found: Revealed, answer: Answer) -> bool:
    match ask:
        case Choose() | Point():
            return answer in found.right
        case Number(value):
            if not isinstance(answer, int | float):
                raise TypeError(f"the answer to a number is {answer!r}: take answers from accepted()")
            true = found.values[value]
            return abs(answer - true) <= ask.tolerance(true)
        case Draw(within=within):
            shown = np.clip(true_heights(found, ask), *ask.y_range)
            return float(np.abs(np.array(answer) - shown).mean()) <= within


def true_heights(found: Revealed, ask: Draw) -> Array:
    """Returns (SAMPLES,) the heights of the true curve at `places`. Raises ValueError where the step has no curve."""
    if found.curve is None:
        raise ValueError("the step has no curve to compare with: reveal it with the runs of its question")
    return sampled(found.curve, places(ask))


def places(ask: Draw) -> Array:
    """(SAMPLES,) where along x a drawn curve has its heights."""
    return np.linspace(*ask.x_range, SAMPLES)
