"""Whether the times of a sensor are in the unit that they should be in, and those of the images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.plausibility.doubt import Doubt


@dataclass(frozen=True)
class Rates:
    """Rates of the measurements of a kind of sensor, lowest and highest [Hz]."""

    possible_hz: tuple[float, float]
    """What a file may have. Outside of them, another unit explains the times better: IMUs of 10 to 2,000 Hz, receivers
    of 0.1 to 20 Hz and wheels of 1 to 500 Hz reach these limits in a wrong unit only."""
    usual_hz: tuple[float, float]
    """A unit must lead into these to be named."""


ANY_RATE = Rates((0.0, np.inf), (0.0, np.inf))
UNITS = (
    ((1e-3, "milliseconds in time_s"), (1e-6, "microseconds in time_s"), (1e-9, "nanoseconds in time_s")),
    (
        (1e3, "microseconds in time_ns"),
        (1e6, "milliseconds in time_ns"),
        (1e9, "seconds in time_ns"),
    ),
)
"""Factors of times that are too far apart, and too near, with the mistakes that they undo."""
BEFORE_NS = 100_000_000
"""What is measured longer before the first image is skipped."""
BARE = 0.1
"""Share of the images' time without measurements at which those outside are worth a sentence."""


def time_doubts(
    where: str, rates: Rates, times_ns: NDArray[np.int64], frames_ns: NDArray[np.int64]
) -> tuple[Doubt, ...]:
    """Returns doubts about the times (N,) of a sensor's measurements [ns], with those of the images (M,)."""
    if len(times_ns) < 2 or not len(frames_ns):
        return ()
    outside = _outside(times_ns, frames_ns)
    between_s = float(np.median(np.diff(times_ns))) * 1e-9
    slowest, fastest = rates.possible_hz
    if not slowest <= 1 / between_s <= fastest:
        units = UNITS[0] if 1 / between_s < slowest else UNITS[1]
        low, high = rates.usual_hz
        likely = next((words for factor, words in units if low <= 1 / (between_s * factor) <= high), None)
        what = f"this looks like {likely}" if likely else "no such sensor has this rate"
        return (
            Doubt(
                "time_unit",
                f"{where}: its measurements are {between_s:.3g} s apart, and {outside} of {len(times_ns)} lie outside "
                f"the images' time: {what}; give seconds in time_s or nanoseconds in time_ns.",
            ),
        )
    slack = 1.5e9 * between_s
    bare_ns = max(0.0, times_ns[0] - frames_ns[0] - slack) + max(0.0, frames_ns[-1] - times_ns[-1] - slack)
    span_ns = float(frames_ns[-1] - frames_ns[0])
    if not outside or bare_ns <= BARE * span_ns:
        return ()
    return (
        Doubt(
            "outside_images",
            f"{where}: {outside} of {len(times_ns)} measurements lie outside the images' time, of which "
            f"{min(1.0, bare_ns / span_ns):.0%} has none: check the unit of its times and clock_offset_s.",
        ),
    )


def _outside(times_ns: NDArray[np.int64], frames_ns: NDArray[np.int64]) -> int:
    return int(((times_ns < frames_ns[0] - BEFORE_NS) | (times_ns > frames_ns[-1])).sum())
