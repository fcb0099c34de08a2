"""Two runs over the same frames, stretch by stretch: whether one of them is better all along, or by one event.

Runs are exact, so on these frames the smaller error is a fact. It says little of the next frames: errors of odometry
accumulate, and one event changes all that follow. So the common frames are cut into stretches that do not overlap, and
each stretch is a pair: the relative error of both runs over it, which no event outside of the stretch changes. Where a
method has no metric unit, that is measured in the scale of its stretch before, so that a scale that was lost once
counts once. The pairs are tested as `ispom gate` tests pairs of runs. Neighbouring stretches whose pairs are alike are
joined before: they are no two observations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.trajectory_error import TrajectoryError
from ispom.geometry import Array
from ispom.types import Trajectory

from ...engine.differences.paths import path_length
from ..experiments.statistics import holm
from ..gate.change import FAILED, Change, change, pairs_needed

Verdict = Literal["a", "b", "same", "cannot tell"]
"""The better run, or neither."""
MOST, LEAST_FRAMES = 20, 5
"""Stretches, and frames of one."""
EFFECT, LEVEL, LOCATED = math.log(1.01), 0.01, 1.0
"""As `ispom gate` has them: the margin of errors, as the logarithm of a ratio; the probability of a false alarm over
all tests together; the margin of the share of localised frames [percentage points]."""
NOTHING = 1e-9
"""Added to both errors [m]: what is below a nanometre is rounding."""
ALIKE = 2.0
"""Neighbouring stretches are alike where their correlation exceeds this many of its standard deviations."""
DOMINANT = 2 / 3
"""A stretch with more than this share of the whole difference of squared errors is named."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """One number of each stretch: how much larger B's error is."""

    stretches: tuple[tuple[int, int], ...]
    """First and last frame of each."""
    values: Array
    """(N,) logarithm of B's error / A's error, or A's share of localised frames - B's [percentage points]; `FAILED`
    where only A has poses there, -`FAILED` where only B has."""
    dominant: tuple[int, int, float] | None = None
    """First and last frame of the stretch with most of the difference, and its share of it."""


@dataclass(frozen=True)
class Tested:
    """What the stretches say."""

    verdict: Verdict
    stretches: int
    smaller_in_b: int
    """Stretches in which B's error is smaller."""
    change: Change | None
    """None where there are too few stretches to test."""


def error_pairs(a: TrajectoryError, b: TrajectoryError, times_ns: NDArray[np.int64]) -> Pairs:
    """Returns the relative errors of position of both over each stretch of the frames at `times_ns` (N,)."""
    count = min(MOST, (len(times_ns) - 1) // LEAST_FRAMES)
    found: list[tuple[int, int, float, float]] = []
    scales = [1.0, 1.0] if a.alignment != "sim3" else None
    for low, high in pairwise(np.linspace(0, len(times_ns) - 1, count + 1).astype(int).tolist() if count > 0 else []):
        within = times_ns[low : high + 1]
        of_a, of_b = (np.intersect1d(error.estimate.times_ns, within) for error in (a, b))
        both = np.intersect1d(of_a, of_b)
        if 2 * len(both) > len(within):
            parts = [_part(error, both) for error in (a, b)]
            if scales is not None:
                found.append((low, high, _relative_error(parts[0], scales[0]), _relative_error(parts[1], scales[1])))
            if a.alignment == "sim3":
                scales = list(map(_scale, parts))
        elif 2 * len(of_a) > len(within):
            found.append((low, high, 0.0, math.inf))
        elif 2 * len(of_b) > len(within):
            found.append((low, high, math.inf, 0.0))
    values = np.array([_log_ratio(x, y) for *_, x, y in found])
    return Pairs(tuple((low, high) for low, high, *_ in found), values, _dominant(found))


def share_pairs(frames: NDArray[np.int64], a: NDArray[np.bool_], b: NDArray[np.bool_]) -> Pairs:
    """Returns the difference of the shares of localised frames over each stretch; `a` and `b` (N,) say whether each run
    is localised at `frames` (N,)."""
    count = min(MOST, len(frames) // LEAST_FRAMES)
    edges = np.linspace(0, len(frames), count + 1).astype(int).tolist() if count else []
    values = [100 * (a[i:j].mean() - b[i:j].mean()) for i, j in pairwise(edges)]
    return Pairs(tuple((int(frames[i]), int(frames[j - 1])) for i, j in pairwise(edges)), np.array(values))


def needed(pairs: Sequence[Pairs]) -> int:
    """Returns how many stretches of each can show anything."""
    return pairs_needed(LEVEL, max(sum(bool(each.values.any()) for each in pairs), 1))


def tested(pairs: Sequence[Pairs], margins: Sequence[float]) -> list[Tested]:
    """Returns what each of these tests says, with one probability of a false alarm over all of them (Holm). One in
    which nothing differs is no test."""
    independent, enough = [_independent(each.values) for each in pairs], needed(pairs)
    changes = [
        change(values, margin, LEVEL) if len(values) >= enough else None
        for values, margin in zip(independent, margins, strict=True)
    ]
    some = [found for found in changes if found is not None and found.same < found.pairs]
    adjusted = zip(some, holm([c.p_worse for c in some]), holm([c.p_better for c in some]), strict=True)
    known = {id(found): replace(found, p_worse=worse, p_better=better) for found, worse, better in adjusted}
    result = []
    for each, values, margin, first in zip(pairs, independent, margins, changes, strict=True):
        found = known.get(id(first), first)
        result.append(Tested(_verdict(each, found, margin), len(values), int((values < 0).sum()), found))
    return result


def _verdict(pairs: Pairs, found: Change | None, margin: float) -> Verdict:
    """As a line of `ispom gate`, where B is the run after the change."""
    if len(pairs.values) and not pairs.values.any():
        return "same"  # to the last bit
    if found is None:
        return "cannot tell"
    if found.p_worse <= LEVEL and found.mean > 0:
        return "a"
    if found.p_better <= LEVEL and found.mean < 0:
        return "b"
    return "same" if found.within(margin) else "cannot tell"


def _independent(values: Array) -> Array:
    """The values, neighbours joined as long as they are alike."""
    while len(values) > 3:
        away = values - values.mean()
        spread = float(away @ away)
        if not spread or float(away[1:] @ away[:-1]) / spread <= ALIKE / math.sqrt(len(values)):
            break
        values = values[: len(values) // 2 * 2].reshape(-1, 2).mean(axis=1)
    return values


def _log_ratio(a: float, b: float) -> float:
    if a == b:
        return 0.0
    if math.isinf(a) or math.isinf(b):
        return FAILED if math.isinf(b) else -FAILED
    return math.log((b + NOTHING) / (a + NOTHING))


Part = tuple[Trajectory, Trajectory]
"""Poses of an estimate in its own world and unit, and the true ones."""


def _part(error: TrajectoryError, times_ns: NDArray[np.int64]) -> Part:
    there = np.isin(error.estimate.times_ns, times_ns)
    return error.estimate.select(there), error.reference.select(there)


def _relative_error(part: Part, scale: float) -> float:
    """The error of the motion from the first pose to the last, seen from the first [m]."""
    moved, true = (path.rotations[0].T @ (path.translations[-1] - path.translations[0]) for path in part)
    return float(np.linalg.norm(scale * moved - true))


def _scale(part: Part) -> float:
    """The true length of the way over the estimated one."""
    estimated, true = (path_length(path.translations) for path in part)
    return true / estimated if estimated else 1.0


def _dominant(found: Sequence[tuple[int, int, float, float]]) -> tuple[int, int, float] | None:
    differences = [(low, high, y * y - x * x) for low, high, x, y in found if math.isfinite(x) and math.isfinite(y)]
    whole = sum(abs(difference) for *_, difference in differences)
    if not whole:
        return None
    low, high, most = max(differences, key=lambda each: abs(each[2]))
    share = abs(most) / whole
    return (low, high, share) if share > DOMINANT and len(differences) > 1 else None
