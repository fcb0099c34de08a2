"""Matches by time: images of two cameras, and the ground truth at the times of images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.solvers.trajectory.interpolation import interpolate
from ispom.types import Trajectory

MAX_PAIR_NS = 2_000_000
"""Largest difference between the times of two images of a pair, whose cameras are triggered together."""
MAX_TRUTH_GAP_NS = 100_000_000
"""Largest gap over which ground truth is interpolated."""


def pairs(left_ns: NDArray[np.int64], right_ns: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns indices (N,) of left images and of their partners, at most MAX_PAIR_NS from each other; both times are
    increasing."""
    if not len(left_ns) or not len(right_ns):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    partner = _nearest(right_ns, left_ns)
    mutual = _nearest(left_ns, right_ns)[partner] == np.arange(len(left_ns))
    left_index = np.flatnonzero(mutual & (abs(right_ns[partner] - left_ns) <= MAX_PAIR_NS))
    return left_index, partner[left_index]


def unmatched_note(left: int, right: int, matched: int) -> tuple[str, ...]:
    """Returns a note about images without a partner; nothing where there are none."""
    if left == right == matched:
        return ()
    return (
        f"{left - matched} of {left} left and {right - matched} of {right} right images have no partner "
        "of the same time: skipped.",
    )


def truth_at(truth: Trajectory, times_ns: NDArray[np.int64], gap_ns: int = MAX_TRUTH_GAP_NS) -> Trajectory | None:
    """Returns the ground truth at those times (N,) that it covers, interpolated over at most gap_ns; None without
    any."""
    if not len(truth):
        return None
    after = np.searchsorted(truth.times_ns, times_ns).clip(0, len(truth) - 1)
    before = np.where(truth.times_ns[after] == times_ns, after, after - 1)
    inside = (before >= 0) & (times_ns <= truth.times_ns[-1])
    covered = inside & (truth.times_ns[after] - truth.times_ns[before] <= gap_ns)
    return interpolate(truth, times_ns[covered], "linear") if covered.any() else None


def no_truth_note(path: Path, found: Trajectory | None) -> tuple[str, ...]:
    """Returns a note where a file of truth covers no image."""
    return () if found is not None else (f"{path} has no pose at the times of the images: no ground truth.",)


def _nearest(times_ns: NDArray[np.int64], queries_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    after = np.searchsorted(times_ns, queries_ns).clip(0, len(times_ns) - 1)
    before = (after - 1).clip(0)
    return np.where(abs(times_ns[before] - queries_ns) <= abs(times_ns[after] - queries_ns), before, after)
