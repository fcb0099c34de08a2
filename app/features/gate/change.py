"""The change of a quantity over pairs of runs: how large it is, and whether it can be chance.

Each pair is a run before and after on the same images. The logarithm of after / before is tested by Wilcoxon's
signed-rank test, one-sided, against the smallest change of interest. The estimate (Hodges and Lehmann 1963) and the
interval are those that belong to this test.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import norm, wilcoxon

from ispom.geometry import Array

MOST_EXACT = 50
"""Up to so many pairs the distribution of the statistic is computed exactly; above, by its normal limit."""
HALVINGS = 48
"""Of the range of the logarithms, until the bounds of the interval are known to all digits that matter."""


@dataclass(frozen=True)
class Change:
    """Of one quantity, from before to after, over pairs; as logarithms of ratios."""

    pairs: int
    same: int
    """Pairs in which nothing changed, to the last bit."""
    estimate: float
    low: float | None
    """Each bound holds with 1 - level; None where there are too few pairs for one."""
    high: float | None
    p_worse: float
    """Probability of such pairs where the quantity grew by the smallest change of interest, or less."""
    p_better: float
    """Probability of such pairs where it fell by the smallest change of interest, or less."""


def change(logs: Array, effect: float, level: float) -> Change:
    """Returns the change of `logs` (N,), N >= 1: the logarithm of after / before of each pair.

    `effect`: the smallest change of interest, as a logarithm >= 0; `level`: probability in (0, 0.5).
    """
    rising, falling = np.sort(logs), np.sort(-logs)
    middle = logs.size * (logs.size + 1) / 4
    estimate = (_shift(rising, middle) - _shift(falling, middle)) / 2
    low = high = None
    if (critical := _critical(logs.size, level)) is not None:
        low, high = _shift(rising, critical - 0.5), -_shift(falling, critical - 0.5)
    grew, fell = probability_of_growth(logs, effect), probability_of_growth(-logs, effect)
    return Change(logs.size, int((logs == 0).sum()), estimate, low, high, grew, fell)


def probability_of_growth(logs: Array, effect: float) -> float:
    """Returns the probability of such pairs, or of more extreme ones, where nothing grew by more than `effect`."""
    differences = logs - effect
    if not differences.any():
        return 1.0
    method = "exact" if differences.size <= MOST_EXACT else "approx"
    found: Any = wilcoxon(differences, alternative="greater", method=method, correction=True)
    return float(found.pvalue)


def pairs_needed(level: float, tests: int) -> int:
    """Returns how many pairs can show anything: if all have one sign, that has the probability 2^-pairs."""
    return math.ceil(math.log2(tests / level))


def _shift(rising: Array, rank_sum: float) -> float:
    """Returns the shift by which the positive differences' ranks no longer sum up to more than `rank_sum`.

    That sum is the number of pairs i <= j whose mean is larger than the shift (Tukey), which is counted.
    """
    low, high = float(rising[0]), float(rising[-1])
    places = np.arange(rising.size)
    for _ in range(HALVINGS if low < high else 0):
        shift = (low + high) / 2
        first = np.searchsorted(rising, 2 * shift - rising, side="right")
        above = (rising.size - np.maximum(first, places)).sum()
        low, high = (low, shift) if above <= rank_sum else (shift, high)
    return (low + high) / 2


def _critical(pairs: int, level: float) -> float | None:
    """Returns the least sum of ranks that chance reaches with `level` or less; None where it reaches every sum more
    often."""
    if pairs > MOST_EXACT:
        spread = math.sqrt(pairs * (pairs + 1) * (2 * pairs + 1) / 24)
        return math.ceil(pairs * (pairs + 1) / 4 + float(norm.isf(level)) * spread)
    ways = np.ones(1)
    for rank in range(1, pairs + 1):  # of the sums: with this rank, or without it
        ways = np.pad(ways, (0, rank)) + np.pad(ways, (rank, 0))
    at_least = np.cumsum(ways[::-1])[::-1] / 2.0**pairs
    rare = np.flatnonzero(at_least <= level)
    return float(rare[0]) if rare.size else None
