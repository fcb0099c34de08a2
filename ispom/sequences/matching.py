"""What belongs together by its time: images of two cameras, and the truth at the times of images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.solvers.trajectory.interpolation import interpolate
from ispom.types import Trajectory

PAIR_NS = 2_000_000
"""Images of two cameras exposed together differ by less than this."""
TRUTH_GAP_NS = 100_000_000
"""Truth is not interpolated over a longer gap."""


def pairs(left_ns: NDArray[np.int64], right_ns: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices (N,) of left images and of their partners, at most PAIR_NS from each other; both times are increasing."""
    if not len(left_ns) or not len(right_ns):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    partner = _nearest(right_ns, left_ns)
    mutual = _nearest(left_ns, right_ns)[partner] == np.arange(len(left_ns))
    left_index = np.flatnonzero(mutual & (abs(right_ns[partner] - left_ns) <= PAIR_NS))
    return left_index, partner[left_index]


def unmatched_note(left: int, right: int, matched: int) -> tuple[str, ...]:
    """A note about images without a partner; nothing where there are none."""
    if left == right == matched:
        return ()
    return (
        f"{left - matched} of {left} left and {right - matched} of {right} right images have no partner "
        "of the same time: skipped.",
    )


def truth_at(truth: Trajectory, times_ns: NDArray[np.int64], gap_ns: int = TRUTH_GAP_NS) -> Trajectory | None:
    """The truth at those of the times (N,) that it covers, interpolated over gap_ns at most; None: it covers none."""
    if not len(truth):
        return None
    after = np.searchsorted(truth.times_ns, times_ns).clip(0, len(truth) - 1)
    before = np.where(truth.times_ns[after] == times_ns, after, after - 1)
    inside = (before >= 0) & (times_ns <= truth.times_ns[-1])
    covered = inside & (truth.times_ns[after] - truth.times_ns[before] <= gap_ns)
    return interpolate(truth, times_ns[covered], "linear") if covered.any() else None


def no_truth_note(path: Path, found: Trajectory | None) -> tuple[str, ...]:
    """A note where a file of truth covers no image."""
    return () if found is not None else (f"{path} has no pose at the times of the images: no ground truth.",)


def _nearest(times_ns: NDArray[np.int64], queries_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    after = np.searchsorted(times_ns, queries_ns).clip(0, len(times_ns) - 1)
    before = (after - 1).clip(0)
    return np.where(abs(times_ns[before] - queries_ns) <= abs(times_ns[after] - queries_ns), before, after)
