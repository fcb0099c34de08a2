"""Answers of people, and which of them are right."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ispom.geometry import Array

from .lesson import Ask, Choose, Draw, Number, Point
from .reveal import Revealed, sampled

SAMPLES = 24
"""Of a drawn curve, evenly over its range of x."""
Answer = int | float | tuple[float, ...]
"""The place of an option or the id of a track, a number, or the (SAMPLES,) heights of a curve."""


def accepted(ask: Ask, given: Any, tracks: Sequence[int] = ()) -> Answer | None:
    """What somebody sent, where it is an answer to this; else None. `tracks` are the ids of those in the picture."""
    if isinstance(given, bool):
        return None
    match ask:
        case Choose(options):
            return given if isinstance(given, int) and 0 <= given < len(options) else None
        case Point():
            return given if isinstance(given, int) and given in tracks else None
        case Number():
            return float(given) if isinstance(given, int | float) and math.isfinite(given) else None
        case Draw():
            good = isinstance(given, list) and len(given) == SAMPLES and all(map(_is_height, given))
            return tuple(map(float, given)) if good else None


def _is_height(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def is_right(ask: Ask, found: Revealed, answer: Answer) -> bool:
    match ask:
        case Choose() | Point():
            return answer in found.right
        case Number(value, _, within, percent):
            assert isinstance(answer, int | float)
            true = found.values[value]
            return abs(answer - true) <= max(within, abs(true) * percent / 100)
        case Draw(within=within):
            assert found.curve is not None and isinstance(answer, tuple)
            shown = np.clip(sampled(found.curve, places(ask)), *ask.y_range)
            return float(np.abs(np.array(answer) - shown).mean()) <= within


def places(ask: Draw) -> Array:
    """(SAMPLES,) where along x a drawn curve has its heights."""
    return np.linspace(*ask.x_range, SAMPLES)
