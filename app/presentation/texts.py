"""Numbers and terms as people read them, the same everywhere."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

ALIGNMENTS = {
    "none": "none: coordinates are compared as they are",
    "first": "first: the first compared poses coincide",
    "scale": "scale: only the unit is fitted, over all compared poses",
    "se3": "se3: rotation and translation, no scale, fitted over all compared poses",
    "sim3": "sim3: rotation, translation and scale, fitted over all compared poses",
}
"""What each way to align a trajectory does."""
ALIGNED = {
    "none": "not aligned",
    "first": "first poses aligned",
    "scale": "scale aligned",
    "se3": "SE(3)",
    "sim3": "Sim(3)",
}
"""The same in a column of a table."""
PROVISIONAL = "provisional"
"""Of a pose that is not metric yet, or of its error."""
ROUNDING_M = 1e-9
"""A length below a nanometre is rounding,"""
ROUNDING_DEG = 1e-9
"""and so is such an angle."""


@dataclass(frozen=True)
class Unit:
    """A unit in which numbers are printed."""

    name: str
    size: float
    """In the unit in which the numbers are computed."""

    def of(self, value: float) -> str:
        """The value's number in this unit."""
        return digits(value / self.size)


KILOMETRE, METRE, MILLIMETRE = Unit("km", 1000.0), Unit("m", 1.0), Unit("mm", 0.001)
SECOND, MILLISECOND = Unit("s", 1.0), Unit("ms", 0.001)


def digits(value: float) -> str:
    """Three significant digits of a number from 1 on (19.7, 5.93), two of a smaller one (0.28, 0.0028)."""
    size = abs(value)
    if not size or not math.isfinite(size):
        return f"{size:.0f}" if not size else str(value)
    significant = 3 if float(f"{size:.2g}") >= 1 else 2
    rounded = float(f"{size:.{significant}g}")
    return f"{value:.{max(0, significant - 1 - math.floor(math.log10(rounded)))}f}"


def length_unit(metres: Iterable[float | None]) -> Unit:
    """The unit that all these lengths share in a column: one in which neither the least nor the largest is unreadable.

    Nothing is printed in micrometres: 0.25 mm stands beside 19.7 mm.
    """
    sizes = [abs(m) for m in metres if m is not None and math.isfinite(m) and abs(m) >= ROUNDING_M]
    least, largest = min(sizes, default=0.0), max(sizes, default=0.0)
    if least >= 1000:
        return KILOMETRE
    return METRE if largest >= 10 or (largest >= 1 and least >= 0.01) else MILLIMETRE


def length(metres: float, unit: Unit | None = None) -> str:
    """A length with its unit: 83.9 mm, 6.83 m, 0.28 mm."""
    unit = unit or length_unit([metres])
    return f"{unit.of(metres) if not abs(metres) < ROUNDING_M else 0} {unit.name}"


def lengths(metres: Iterable[float | None], unknown: str = "") -> list[str]:
    """The cells of a column of lengths, all in one unit; `unknown` stands for None."""
    values = list(metres)
    unit = length_unit(values)
    return [unknown if m is None else length(m, unit) for m in values]


def angle(degrees: float) -> str:
    """An angle with its unit: 12.3°, 0.010°."""
    return f"{digits(degrees) if not abs(degrees) < ROUNDING_DEG else 0}°"


def computing_time(seconds: float, unit: Unit | None = None) -> str:
    """How long something was computed, with its unit: 35.3 ms, 1.24 s."""
    unit = unit or (SECOND if abs(seconds) >= 1 else MILLISECOND)
    return f"{unit.of(seconds)} {unit.name}"


def size(count: int) -> str:
    """Of bytes: 12.3 MB."""
    from rich import filesize  # imported here: a run without a terminal does not load rich

    return filesize.decimal(count)


def duration(seconds: float) -> str:
    """Whole seconds: 45 s, 3 min 20 s."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"
