"""Checks whether one of both jumps where the other one does not: single wild poses, and origins that start again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.types import Trajectory

MIN_JUMP = 20.0
"""Least difference of two steps that is a jump, in standard deviations of these differences (from their median)."""
MIN_STEPS = 5.0
"""The same in median steps."""
MAX_INTERVAL = 3.0
"""Longest interval, in median intervals, between whose ends a step is judged: over a gap much can happen."""
CLEARLY = 3.0
"""Least ratio of both accelerations, each relative to its usual size, by which one of the two has jumped."""
SPIKE_POSES = 5
"""Largest number of poses between two jumps of which the second undoes the first."""
UNDONE = 0.3
"""Largest distance of the pose after a spike from the one before it, relative to the spike."""


@dataclass(frozen=True)
class Jump:
    whose: Literal["estimate", "reference"]
    first: int
    """Index of the first pose after the jump."""
    last: int | None
    """Index of the last wrong pose, if the path returns; None if it does not."""


def jumps(own: Trajectory, true: Trajectory) -> list[Jump]:
    """Returns the jumps between associated poses. A jump is skipped if it cannot be decided which path has it."""
    steps = [np.diff(each.translations, axis=0) for each in (own, true)]
    lengths = [np.linalg.norm(step, axis=1) for step in steps]
    moving = (lengths[0] > 0) & (lengths[1] > 0)
    if moving.sum() < 16:
        return []
    scale = float(np.median(lengths[1][moving] / lengths[0][moving]))
    excess = scale * lengths[0] - lengths[1]
    intervals = np.diff(true.times_ns)
    usual = max(float(1.4826 * np.median(abs(excess - np.median(excess)))), 1e-9)
    limit = max(MIN_JUMP * usual, MIN_STEPS * float(np.median(lengths[1][moving])))
    near = intervals <= MAX_INTERVAL * max(float(np.median(intervals)), 1.0)
    found: list[Jump] = []
    jerks = [_relative_accelerations(step) for step in steps]
    at = [int(i) for i in np.flatnonzero((abs(excess) > limit) & near)]
    while at:
        i = at.pop(0)
        a, b = jerks[0][i], jerks[1][i]
        if max(a, b) < CLEARLY * min(a, b):
            continue
        whose, mine = ("estimate", own) if a > b else ("reference", true)
        last = _end_of_spike(mine.translations, i, at)
        if last is not None:
            at = [j for j in at if j > last]
        found.append(Jump(whose, i + 1, last))
    return found


def _relative_accelerations(steps: Array) -> Array:
    """(N - 1,) changes of the step against those beside it, in median changes."""
    changes = np.linalg.norm(np.diff(steps, axis=0), axis=1)
    usual = max(float(np.median(changes)), 1e-12)
    before, after = np.append(0.0, changes), np.append(changes, 0.0)
    return np.maximum(before, after) / usual


def _end_of_spike(positions: Array, i: int, jumps_after: list[int]) -> int | None:
    """Returns the last wrong pose after the jump from pose i; None where the path continues from there."""
    size = float(np.linalg.norm(positions[i + 1] - positions[i]))
    for j in jumps_after:
        if j - i > SPIKE_POSES:
            break
        if np.linalg.norm(positions[j + 1] - positions[i]) < UNDONE * size:
            return j
    return None


def parts(count: int, cuts: list[int]) -> list[NDArray[np.intp]]:
    """Returns the indices of each part between jumps; cuts are the first poses after them."""
    return [part for part in np.split(np.arange(count), sorted(cuts)) if len(part)]
