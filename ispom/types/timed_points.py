"""What a sensor measured point by point while it moved: a laser profiler, a LiDAR."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array


@dataclass(frozen=True, eq=False)
class TimedPoints:
    """Points in the sensor's frame, each at its own time."""

    times_ns: NDArray[np.int64]
    """(N,) on the clock of the exposures, in any order [ns]."""
    xyz_in_laser: Array
    """(N, 3) [m]."""

    def __post_init__(self) -> None:
        if self.xyz_in_laser.shape != (len(self.times_ns), 3):
            raise ValueError(f"{len(self.times_ns)} times with points {self.xyz_in_laser.shape}")

    def __len__(self) -> int:
        return len(self.times_ns)

    def select(self, index: NDArray) -> TimedPoints:
        """Those of a boolean mask or index array."""
        return TimedPoints(self.times_ns[index], self.xyz_in_laser[index])
