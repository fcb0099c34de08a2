"""Returns poses at any time, for sensors that measure thousands of times per second."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, RotationSpline

from ispom.solvers.trajectory.interpolation import interpolate
from ispom.types import Trajectory

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

Between = Literal["linear", "spline"]
"""linear: constant velocity between poses, spherical linear rotation; spline: continuous accelerations."""


def poses_at(trajectory: Trajectory, times_ns: NDArray[np.int64], kind: Between) -> Trajectory:
    """Returns the poses at times (M,) [ns], in any order; outside the trajectory's span, those of the nearest end.

    The spline passes through every pose: cubic in position, and in rotation as RotationSpline. Fewer than three poses
    are joined linearly. The result's times are `times_ns` in their order. Raises ValueError for an empty trajectory.
    """
    if kind == "linear" or len(trajectory) < 3:
        return interpolate(trajectory, times_ns, "linear")
    return Curve(trajectory).at(times_ns)


@dataclass(frozen=True, eq=False)
class Curve:
    """The spline through at least three poses, made once for many evaluations."""

    through: Trajectory

    @cached_property
    def _splines(self) -> tuple[RotationSpline, CubicSpline]:
        from scipy.interpolate import CubicSpline  # imported here: it takes 14 MB, and few runs need it

        knots_s = (self.through.times_ns - self.through.times_ns[0]) * 1e-9
        rotations = RotationSpline(knots_s, Rotation.from_matrix(self.through.rotations))
        return rotations, CubicSpline(knots_s, self.through.translations)

    def at(self, times_ns: NDArray[np.int64]) -> Trajectory:
        """Returns the poses at times (M,) [ns], see `poses_at`."""
        times_ns, (start, *_, end) = np.asarray(times_ns, np.int64), self.through.times_ns
        asked_s = (np.clip(times_ns, start, end) - start) * 1e-9
        turn, place = self._splines
        return Trajectory(times_ns, turn(asked_s).as_matrix(), place(asked_s), self.through.frame)


def known_at(trajectory: Trajectory, times_ns: NDArray[np.int64], gap: float = 3.0) -> NDArray[np.bool_]:
    """Returns whether each time (M,) lies between two poses whose interval is at most `gap` times the median."""
    if len(trajectory) < 2:
        return np.zeros(len(times_ns), bool)
    intervals = np.diff(trajectory.times_ns)
    after = np.searchsorted(trajectory.times_ns, times_ns, side="right").clip(1, len(trajectory) - 1)
    inside = (times_ns >= trajectory.times_ns[0]) & (times_ns <= trajectory.times_ns[-1])
    return inside & (intervals[after - 1] <= gap * np.median(intervals))
