"""How an integration came to its poses, as plain arrays: for whoever wants to see it step by step."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.types.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class SegmentFit:
    """A segment of video poses and the two stereo poses that it was fitted to (section 6.3; Fig. 7)."""

    span_ns: tuple[int, int]
    """The times t_j and t_j+1 of the two stereo exposures."""
    video: Trajectory
    """world_from_video in its own world and unit: inside the segment, and the poses that bracket its two ends."""
    own_ends: Trajectory
    """(2,) the same, interpolated at both ends."""
    metric_ends: Trajectory
    """(2,) world_from_video after the stereo estimator [m], at both ends."""
    scale: float | None = None
    """Metres per unit; None where the segment is too short for a ratio of lengths."""
    turn_rad: float | None = None
    """Angle between the two segment vectors, once the first orientations agree; None as `scale`."""
    residual_rad: float = 0.0
    """The rotation by which the last orientation missed its goal; it is spread over the segment."""


@dataclass(frozen=True, eq=False)
class SplineFit:
    """A spline through the exposures of a window, before and after its adjustment."""

    times_ns: NDArray[np.int64]
    """(E,) of the exposures, as stamped."""
    video: NDArray[np.bool_]
    """(E,) which of them are the video camera's; the others are stereo pairs."""
    before: Array
    """(E, 3) world_from_rig positions [m] of the spline at the exposures, as it was begun with."""
    after: Array
    """(E, 3) likewise, adjusted."""
    knots_ns: NDArray[np.int64]
    """(K,) when each knot counts most."""
    knots_before: Array
    """(K, 3) [m]."""
    knots_after: Array
    """(K, 3) [m]."""
    errors_before: Array
    """(E,) median error of what was seen at each exposure [standard deviations]; NaN where nothing was."""
    errors_after: Array
    """(E,) likewise, adjusted."""
    cost_before: float
    cost_after: float
    iterations: int

    def moved(self, onto: Pose) -> SplineFit:
        """In another world."""
        names = ("before", "after", "knots_before", "knots_after")
        return replace(self, **{name: onto.apply(getattr(self, name)) for name in names})
