"""What a gate can find: stated before its first run, and again when pairs are known.

*Power* is the share of gates that find a change. It is computed by drawing the pairs of many gates with a fixed seed
and testing each, by the very tests of `change`. Before the first run the scatter of the pairs
is not known. It is taken from the baseline as if before and after had nothing in common but their source: sqrt(2) times
the scatter of the logarithms of its errors between seeds. That is the least favourable case; code that changes little
keeps most of each run, and its pairs scatter less.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata, t

from ispom.geometry import Array

from ..experiments.row import Row
from ..experiments.statistics import value_of
from .change import critical_sum

POWER = 0.8
"""Share of gates that shall find a change."""
GATES = 300
"""Drawn for each number of pairs: the power is known to 0.025."""
ASSUMED = math.log(1.3)
"""Scatter of a pair's logarithm where the baseline does not show one: it has one seed of each source."""
MOST_PAIRS = 1000
"""A gate that needs more decides nothing."""
HALVINGS = 12
LARGEST = math.log(1e6)
"""Larger changes of an error are not looked for."""


@dataclass(frozen=True)
class Power:
    """What a number of pairs can find of one quantity of a line."""

    line: str
    quantity: str
    pairs: int
    spread: float
    """Standard deviation of the logarithm of after / before."""
    source: str
    """What the spread is of: "baseline", "pairs" or "assumed"."""
    smallest: float | None
    """The smallest growth that POWER of the gates find, as a logarithm; None: none up to LARGEST."""


def power_of(
    line: str, quantity: str, pairs: int, spread: float | None, source: str, effect: float, level: float
) -> Power:
    """`level` is that of the strictest test; `spread` None is assumed to be ASSUMED."""
    known = ASSUMED if spread is None else spread
    smallest = smallest_growth(pairs, known, effect, level)
    return Power(line, quantity, pairs, known, "assumed" if spread is None else source, smallest)


def baseline_spread(rows: Sequence[Row], quantity: str) -> float | None:
    """Returns the scatter that independent pairs of a line's runs would have; None where no source has two seeds."""
    by_source: dict[str, list[float]] = {}
    for row in rows:
        if (value := value_of(row, quantity)) is not None and value > 0:
            by_source.setdefault(row.run.source, []).append(math.log(value))
    squares = sum(float(np.var(logs)) * len(logs) for logs in by_source.values())
    free = sum(len(logs) - 1 for logs in by_source.values())
    return math.sqrt(2 * squares / free) if free > 0 else None


def smallest_growth(pairs: int, spread: float, effect: float, level: float) -> float | None:
    """Returns the smallest growth that POWER of the gates find, where pairs scatter normally by `spread`."""
    noise = spread * np.random.default_rng(0).standard_normal((GATES, pairs))

    def finds(growth: float) -> bool:
        return bool(grown(noise + growth, effect, level).mean() >= POWER)

    low, high = 0.0, LARGEST
    if not finds(high):
        return None
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if finds(middle) else (middle, high)
    return high


def pairs_that_decide(logs: Array, effect: float, level: float, one_sided: bool = False) -> int | None:
    """Returns about how many pairs would decide, if the pairs to come are like `logs` (N,): the least number with which
    the share POWER of the gates does not say "cannot tell". `one_sided`: what fell is decided as well. None: no number
    up to MOST_PAIRS is enough.

    The pairs to come are drawn from those known. That plans a next gate; no verdict rests on it.
    """

    def decides(pairs: int) -> bool:
        drawn = np.random.default_rng(0).choice(logs, (GATES, pairs))
        decided = grown(drawn, effect, level) | _bounded(drawn, effect, level, one_sided)
        if not one_sided:
            decided |= grown(-drawn, effect, level) & (drawn.mean(axis=1) < 0)
        return bool(decided.mean() >= POWER)

    low, high = 1, MOST_PAIRS
    if not decides(high):
        return None
    while high > low + 1 + low // 16:
        middle = math.isqrt(low * high) if high > 4 * low else (low + high) // 2
        low, high = (low, middle) if decides(middle) else (middle, high)
    return high


def grown(logs: Array, effect: float, level: float) -> NDArray[np.bool_]:
    """Returns which gates (G,) with the pairs `logs` (G, N) find a growth by more than `effect`."""
    critical = critical_sum(logs.shape[1], level)
    if critical is None:
        return np.zeros(len(logs), bool)
    return _rank_sum(logs - effect) >= critical


def _bounded(logs: Array, effect: float, level: float, one_sided: bool) -> NDArray[np.bool_]:
    """Returns which gates (G,) show that nothing changed, or only that nothing grew, by more than `effect`."""
    mean, count = logs.mean(axis=1), logs.shape[1]
    if count < 2:
        return np.zeros(len(logs), bool)
    away = t.isf(level, count - 1) * logs.std(axis=1, ddof=1) / math.sqrt(count)
    below = (mean + away <= effect) & grown(-logs, -effect, level)
    if one_sided:
        return below
    return below & (mean - away >= -effect) & grown(logs, -effect, level)


def _rank_sum(differences: Array) -> Array:
    return (rankdata(np.abs(differences), axis=1) * (differences > 0)).sum(axis=1)
