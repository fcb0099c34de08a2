"""Poses over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.geometry import Array, Pose
from ispom.types.camera import Frame


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses world_from_FRAME over time."""

    times_ns: NDArray[np.int64]
    """(N,) strictly increasing [ns]."""
    rotations: Array
    """(N, 3, 3)."""
    translations: Array
    """(N, 3) [m, or the trajectory's own unit]."""
    frame: Frame = "rig"

    def __post_init__(self) -> None:
        n = len(self.times_ns)
        if self.rotations.shape != (n, 3, 3) or self.translations.shape != (n, 3):
            raise ValueError(f"{n} times with {self.rotations.shape} rotations and {self.translations.shape} positions")

    @staticmethod
    def empty(frame: Frame = "rig") -> Trajectory:
        return Trajectory(np.zeros(0, np.int64), np.zeros((0, 3, 3)), np.zeros((0, 3)), frame)

    @staticmethod
    def of(items: list[tuple[int, Pose]], frame: Frame = "rig") -> Trajectory:
        """From (time_ns, pose) in any order; of two at the same time the later in the list counts."""
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

    def pose(self, i: int) -> Pose:
        return Pose(self.rotations[i], self.translations[i])

    def items(self) -> list[tuple[int, Pose]]:
        return [(int(t), self.pose(i)) for i, t in enumerate(self.times_ns)]

    def at(self, time_ns: int) -> Pose | None:
        """The pose at exactly this time, or None."""
        i = int(np.searchsorted(self.times_ns, time_ns))
        return self.pose(i) if i < len(self) and self.times_ns[i] == time_ns else None

    def select(self, index: NDArray) -> Trajectory:
        """The poses of a slice, boolean mask or index array."""
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

    def moved(self, left: Pose | None = None, right: Pose | None = None, frame: Frame | None = None) -> Trajectory:
        """Every pose P as left @ P @ right: `left` changes the world, `right` (OLD_from_FRAME) the moving frame."""
        left, right = left or Pose(), right or Pose()
        return Trajectory(
            self.times_ns,
            left.rotation @ self.rotations @ right.rotation,
            (self.rotations @ right.translation + self.translations) @ left.rotation.T + left.translation,
            frame or self.frame,
        )
