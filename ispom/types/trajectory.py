"""Trajectories, and the fits by which an integration estimates its poses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.geometry import Array, Pose
from ispom.types.rig import FrameName


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """Poses world_from_FRAME over time."""

    times_ns: NDArray[np.int64]
    """(N,) strictly increasing [ns]."""
    rotations: Array
    """(N, 3, 3)."""
    translations: Array
    """(N, 3) [m, or the trajectory's own unit]."""
    frame: FrameName = "rig"

    def __post_init__(self) -> None:
        n = len(self.times_ns)
        if self.rotations.shape != (n, 3, 3) or self.translations.shape != (n, 3):
            raise ValueError(f"{n} times with {self.rotations.shape} rotations and {self.translations.shape} positions")

    @staticmethod
    def empty(frame: FrameName = "rig") -> Trajectory:
        return Trajectory(np.zeros(0, np.int64), np.zeros((0, 3, 3)), np.zeros((0, 3)), frame)

    @staticmethod
    def of(items: list[tuple[int, Pose]], frame: FrameName = "rig") -> Trajectory:
        """Returns the trajectory of (time_ns, pose) in any order; the last one of the list at each time is used."""
        if not items:
            return Trajectory.empty(frame)
        latest = dict(items)
        times = sorted(latest)
        return Trajectory(
            np.array(times, np.int64),
            np.stack([latest[t].rotation for t in times]),
            np.stack([latest[t].translation for t in times]),
            frame,
        )

    def __len__(self) -> int:
        return len(self.times_ns)

    def __repr__(self) -> str:
        seconds = f" over {(self.times_ns[-1] - self.times_ns[0]) * 1e-9:.3f} s" if len(self) else ""
        return f"Trajectory({len(self)} poses of the {self.frame}{seconds}, length {self.length:.4g})"

    def __getitem__(self, index: int | slice) -> Pose | Trajectory:
        """Returns a pose by its number, or the part of a slice. Raises IndexError beyond the last pose."""
        return self.select(index) if isinstance(index, slice) else self.pose(index)

    def pose(self, i: int) -> Pose:
        return Pose(self.rotations[i], self.translations[i])

    def items(self) -> list[tuple[int, Pose]]:
        return [(int(t), self.pose(i)) for i, t in enumerate(self.times_ns)]

    def at(self, time_ns: int) -> Pose | None:
        """Returns the pose at exactly this time, or None."""
        i = int(np.searchsorted(self.times_ns, time_ns))
        return self.pose(i) if i < len(self) and self.times_ns[i] == time_ns else None

    def select(self, index: NDArray | slice) -> Trajectory:
        """Returns the poses of a slice, boolean mask or index array."""
        return Trajectory(self.times_ns[index], self.rotations[index], self.translations[index], self.frame)

    @property
    def xyzw(self) -> Array:
        """Quaternions (N, 4), x, y, z, w, w >= 0."""
        if not len(self):
            return np.zeros((0, 4))
        return Rotation.from_matrix(self.rotations).as_quat(canonical=True)

    @property
    def length(self) -> float:
        """Path length, in the unit of the translations."""
        return float(np.linalg.norm(np.diff(self.translations, axis=0), axis=1).sum())

    def moved(self, left: Pose | None = None, right: Pose | None = None, frame: FrameName | None = None) -> Trajectory:
        """Returns the poses left @ P @ right: `left` changes the world, `right` (OLD_from_FRAME) the moving frame."""
        left, right = left or Pose(), right or Pose()
        return Trajectory(
            self.times_ns,
            left.rotation @ self.rotations @ right.rotation,
            (self.rotations @ right.translation + self.translations) @ left.rotation.T + left.translation,
            frame or self.frame,
        )


@dataclass(frozen=True, eq=False)
class SegmentFit:
    """A segment of video poses and the two stereo poses that it was fitted to (section 6.3; Fig. 7)."""

    span_ns: tuple[int, int]
    """The times t_j and t_j+1 of the two stereo frames."""
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
    """Angle of the last orientation's error, which is distributed over the segment."""


@dataclass(frozen=True, eq=False)
class SplineFit:
    """A spline through the frames of a window, before and after its optimisation."""

    times_ns: NDArray[np.int64]
    """(E,) time stamps of the frames."""
    video: NDArray[np.bool_]
    """(E,) whether each is a frame of the video camera, not a stereo frame."""
    before: Array
    """(E, 3) world_from_rig positions [m] of the spline at the frames, before the optimisation."""
    after: Array
    """(E, 3) the same after the optimisation."""
    knots_ns: NDArray[np.int64]
    """(K,) times at which the weight of each knot is largest."""
    knots_before: Array
    """(K, 3) [m]."""
    knots_after: Array
    """(K, 3) [m]."""
    errors_before: Array
    """(E,) median residual of the observations at each frame [standard deviations]; NaN where there are none."""
    errors_after: Array
    """(E,) the same after the optimisation."""
    cost_before: float
    cost_after: float
    iterations: int

    def moved(self, onto: Pose) -> SplineFit:
        """Returns the fit in another world; `onto` is new_world_from_world."""
        names = ("before", "after", "knots_before", "knots_after")
        return replace(self, **{name: onto.apply(getattr(self, name)) for name in names})
