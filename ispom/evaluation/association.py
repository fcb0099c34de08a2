"""Which pose of an estimate is compared with which pose of a reference."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array
from ispom.types import Trajectory

MAX_DIFFERENCE_NS = 10_000_000


def associate(
    estimate: Trajectory, reference: Trajectory, max_difference_ns: int = MAX_DIFFERENCE_NS
) -> tuple[Trajectory, Trajectory]:
    """The poses that have a partner in time, of both, equally long.

    Each pose of the shorter trajectory goes with the nearest of the longer one, if that is near enough.
    """
    if not len(estimate) or not len(reference):
        return Trajectory.empty(estimate.frame), Trajectory.empty(reference.frame)
    if len(estimate) > len(reference):
        partners, own = associate(reference, estimate, max_difference_ns)
        return own, partners
    own, other = _seconds(estimate), _seconds(reference)
    after = np.searchsorted(reference.times_ns, estimate.times_ns, side="right").clip(0, len(reference) - 1)
    before = (after - 1).clip(0)
    gap_before, gap_after = abs(own - other[before]), abs(other[after] - own)
    nearest = np.where(gap_before <= gap_after, before, after)
    near = np.minimum(gap_before, gap_after) <= max_difference_ns * 1e-9
    return estimate.select(near), reference.select(nearest[near])


def _seconds(trajectory: Trajectory) -> Array:
    """Times (N,) [s] as other programs read them: of two equally near poses they take the same one then."""
    return (trajectory.times_ns.astype(np.longdouble) / 1e9).astype(float)
