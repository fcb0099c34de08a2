"""How much of a reference an estimate answers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.types import Trajectory


@dataclass(frozen=True)
class Coverage:
    given: int
    """Poses of the estimate that were compared."""
    asked: int
    """Poses that the estimate, at its own median rate, would have over the reference's span; at most the reference's
    poses: a reference of a higher rate asks for no more."""
    longest_gap_ns: int
    """Longest time without a compared pose, from the reference's first pose to its last."""


def coverage(estimate: Trajectory, reference: Trajectory, compared_ns: NDArray[np.int64]) -> Coverage:
    """Of whole trajectories with at least one pose each, and the times (K,) of the reference's compared poses."""
    first_ns, last_ns = int(reference.times_ns[0]), int(reference.times_ns[-1])
    asked = len(reference)
    apart_ns = np.diff(np.unique(estimate.times_ns))
    if len(apart_ns):
        interval_ns = float(np.median(apart_ns))
        asked = min(asked, round((last_ns - first_ns) / interval_ns) + 1)
    given = len(np.unique(compared_ns))
    gaps_ns = np.diff(np.concatenate([[first_ns], np.sort(compared_ns), [last_ns]]))
    return Coverage(given, max(asked, given), int(gaps_ns.max()))
