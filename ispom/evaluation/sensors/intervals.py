"""The intervals over which sensors are compared with images, so that noise does not look like a change of the motion.

A clock offset shows in the difference of the rates at the end and at the begin of an interval. If that is mostly noise
of the sensor, longer intervals are used.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.audit.samples import Path
from ispom.geometry import Array

LENGTHS_S = (0.1, 0.3, 1.0, 3.0)
QUIET, LOUD = 0.1, 0.5
"""Share of noise in the changes of the rate: below the first an interval is long enough; above the second, at the
longest one, the clock does not show."""
OVERLAP = 4
"""Number of intervals that begin within the length of one, if they are longer than the first ones."""
MOST_S = 2.5
"""Multiple of the usual interval above which an interval contains a gap."""


def length_s(times_s: Array, rates: Array) -> tuple[float, float]:
    """Returns the length of the intervals [s], and the share of noise in the changes of rates (N, D) at times (N,)
    over it."""
    noise = np.median(abs(np.diff(rates, 2, axis=0)), axis=0) * 1.4826 / np.sqrt(6)
    step, share = float(np.median(np.diff(times_s))), 1.0
    for length in LENGTHS_S:
        apart = max(1, round(length / step))
        if apart >= len(rates) // 2:
            break
        changes = rates[apart:] - rates[:-apart]
        share = float(2 * (noise**2).sum() / max(float((changes**2).mean(axis=0).sum()), 1e-300))
        if share <= QUIET:
            return length, share
    return LENGTHS_S[-1] if share < LOUD else LENGTHS_S[1], share


def intervals(path: Path, length: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Returns numbers of the first and last poses (N,) of intervals of about this length [s]."""
    steps = max(1, round(length / max(path.interval_s, 1e-6)))
    begin = np.arange(0, len(path) - steps, steps if length <= LENGTHS_S[0] else max(1, steps // OVERLAP))
    seconds = path.times_s[begin + steps] - path.times_s[begin]
    begin = begin[seconds <= MOST_S * np.median(seconds)] if len(begin) else begin
    return begin, begin + steps


def thinned(first: NDArray[np.intp], last: NDArray[np.intp], most: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Returns every first, second, third, ... interval, so that there are not too many."""
    step = -(-len(first) // most) or 1
    return first[::step], last[::step]
