"""The change of a quantity over pairs of runs: how large it is, whether it can be chance, and whether there is none.

Each pair is a run before and after on the same images, x = log(after / before) its value. A pair that gave a result on
one side only has the value `FAILED` or -`FAILED`: a failure is larger than any error. With the margin m (the largest
change of no interest) and the level a:

- *Worse*: Wilcoxon's signed-rank test, one-sided, rejects "x grew by no more than m" at a (Holm over all tests).
- *Better*: it rejects "x fell by no more than m" at a, and the mean of x is below 0.
- *Same*: the interval of x lies within -m .. m, and so does that of its mean. Each bound holds with 1 - a: this
  is TOST (two one-sided tests, Schuirmann 1987) by two different tests.
- *Cannot tell*: else.

Where a change does nothing, before and after can be exchanged, so x is symmetric about 0 whatever its tails are. For
that the signed-rank test is exact, also for 7 pairs, where a bootstrap is not. Its interval is that of Walsh averages
(Hodges and Lehmann 1963), which a few runs out of many do not move. Student's t interval of the mean does move then:
that is why "the same" needs both, and one lost run of twenty is not "the same".
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import norm, t, wilcoxon

from ispom.geometry import Array

MOST_EXACT = 50
"""Most pairs with which the distribution of the statistic is computed exactly; with more, its normal limit is used."""
FAILED = 50.0
"""Value of a pair that gave a result before and none after: beyond the logarithm of every ratio of errors."""
HALVINGS = 48
"""Number of halvings of the range of the logarithms after which the bounds of the interval are exact enough."""


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
    mean: float
    mean_low: float | None
    """Each bound of the mean holds with 1 - level, too; None for a single pair."""
    mean_high: float | None

    def at_most(self, margin: float) -> bool:
        """Whether nothing grew by more than `margin`: both upper bounds are below it."""
        return all(bound is not None and bound <= margin for bound in (self.high, self.mean_high))

    def at_least(self, margin: float) -> bool:
        """Whether nothing grew by less than `margin`."""
        return all(bound is not None and bound >= margin for bound in (self.low, self.mean_low))

    def within(self, margin: float) -> bool:
        """Whether it is the same within the margin >= 0."""
        return self.at_least(-margin) and self.at_most(margin)


def change(logs: Array, effect: float, level: float) -> Change:
    """Returns the change of `logs` (N,), N >= 1: the logarithm of after / before of each pair, or `FAILED`.

    `effect`: the margin, as a logarithm >= 0; `level`: probability in (0, 0.5).
    """
    rising, falling = np.sort(logs), np.sort(-logs)
    middle = logs.size * (logs.size + 1) / 4
    estimate = (_shift(rising, middle) - _shift(falling, middle)) / 2
    low = high = None
    if (critical := critical_sum(logs.size, level)) is not None:
        low, high = _shift(rising, critical - 0.5), -_shift(falling, critical - 0.5)
    grew, fell = probability_of_growth(logs, effect), probability_of_growth(-logs, effect)
    mean, mean_low, mean_high = float(logs.mean()), None, None
    if logs.size > 1:
        away = float(t.isf(level, logs.size - 1) * logs.std(ddof=1) / math.sqrt(logs.size))
        mean_low, mean_high = mean - away, mean + away
    return Change(logs.size, int((logs == 0).sum()), estimate, low, high, grew, fell, mean, mean_low, mean_high)


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


def critical_sum(pairs: int, level: float) -> float | None:
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
