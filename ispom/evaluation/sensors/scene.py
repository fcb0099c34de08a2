"""The data that are compared: the path of the images, and the measurements of the sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.audit.samples import Path
from ispom.geometry import Array, Pose
from ispom.sensors.kind import Readings
from ispom.types import FrameName, Kind, Rig, Sensor, Trajectory

FEWEST_POSES = 20
"""Least number of poses of the images for a comparison."""


@dataclass(frozen=True, eq=False)
class SensorScene:
    """The path of a method that used images only, and the readings of the other sensors."""

    rig: Rig
    path: Path
    """world_from_rig in a world of its own, times since `origin_ns`."""
    origin_ns: int
    metric: bool
    """Whether the unit of the path is the metre."""
    readings: Mapping[FrameName, Readings]
    used: frozenset[Kind] = frozenset()
    """Kinds of sensors that a method of the run uses."""

    @staticmethod
    def of(
        rig: Rig,
        trajectory: Trajectory,
        readings: Mapping[FrameName, Readings],
        metric: bool,
        used: frozenset[Kind] = frozenset(),
    ) -> SensorScene:
        """Returns the scene from poses of the rig, or of the video camera if the unit is unknown. Then the rig is
        assumed to turn about that camera."""
        onto = rig.rig_from(trajectory.frame).inverse()
        moved = trajectory.moved(right=Pose(onto.rotation, onto.translation if metric else np.zeros(3)))
        origin_ns = int(trajectory.times_ns[0]) if len(trajectory) else 0
        return SensorScene(rig, Path.of(moved, origin_ns, True), origin_ns, metric, readings, used)

    def scaled(self, metres: float) -> SensorScene:
        """Returns the scene in metres. `metres`: length of the unit of the video camera's path."""
        video, (path, turned) = self.rig.rig_from("video"), (self.path, self.path.rotations)
        assert turned is not None
        positions = metres * path.positions + turned @ video.rotation @ video.inverse().translation
        return replace(self, path=Path(path.times_s, turned, positions), metric=True)

    def measured(self, kind: Kind) -> tuple[FrameName, Sensor, Readings] | None:
        """Returns the first sensor of a kind with its name and readings; None without one, or with too few poses."""
        for name, found in self.readings.items():
            sensor = self.rig.sensors.get(name)
            if found.kind == kind and sensor is not None and found.values and len(self.path) >= FEWEST_POSES:
                return name, sensor, found
        return None

    def seconds(self, times_ns: NDArray[np.int64]) -> Array:
        """Returns times (N,) since the origin [s]."""
        return (times_ns - self.origin_ns) * 1e-9
