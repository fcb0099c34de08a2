"""How well positions between stereo exposures are known: what the integration is for (Table 4)."""

from __future__ import annotations

import numpy as np

from ispom.evaluation.ate import rms
from ispom.geometry import Array
from ispom.solvers.trajectory.interpolation import interpolate
from ispom.types import Trajectory


def between_stereo_rmse_m(estimate: Trajectory, stereo: Trajectory, truth: Trajectory) -> float | None:
    """Root mean square position error of the estimate's poses relative to the stereo pose that opens their segment.

    All are world_from_rig; estimate and stereo share a world, truth may have another. Poses without truth at their
    time, or outside the stereo poses' span, take no part. None where none is left.
    """
    times_ns, opening = _segments(estimate.times_ns, stereo, truth)
    if not len(times_ns):
        return None
    own = _seen_from(stereo, opening, estimate, times_ns)
    true = _seen_from(truth, opening, truth, times_ns)
    return rms(np.linalg.norm(own - true, axis=1))


def spline_between_stereo_rmse_m(estimate: Trajectory, stereo: Trajectory, truth: Trajectory) -> float | None:
    """The same for stereo alone, interpolated by spline at the estimate's times: what the estimate must beat."""
    if len(stereo) < 2:
        return None
    return between_stereo_rmse_m(interpolate(stereo, estimate.times_ns, "bspline"), stereo, truth)


def _segments(times_ns: np.ndarray, stereo: Trajectory, truth: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """The times (K,) that count, and for each the time of the stereo pose that opens its segment."""
    ends = stereo.times_ns[np.isin(stereo.times_ns, truth.times_ns)]
    times_ns = times_ns[np.isin(times_ns, truth.times_ns)]
    if len(ends) < 2:
        return times_ns[:0], times_ns[:0]
    times_ns = times_ns[(times_ns >= ends[0]) & (times_ns <= ends[-1])]
    return times_ns, ends[np.searchsorted(ends, times_ns, side="right") - 1]


def _seen_from(origin: Trajectory, opening_ns: np.ndarray, trajectory: Trajectory, times_ns: np.ndarray) -> Array:
    """Positions (K, 3) of a trajectory at times, in the rig frame of `origin` at the opening times."""
    i, j = np.searchsorted(origin.times_ns, opening_ns), np.searchsorted(trajectory.times_ns, times_ns)
    return np.einsum("kji,kj->ki", origin.rotations[i], trajectory.translations[j] - origin.translations[i])
