"""What simulated sensors share: the scenery in which they measure, late clocks, and outages.

Each measures the true motion, and then errs as its settings say: noise, bias, a lever arm, a clock that is late, an
outage. What the rig holds of it (pose, noise) is what a person would know. The same seed gives the same errors. The
motions `drive` and `loop` are those of a vehicle; only `drive` rolls without sliding sideways.

    sim:city?motion=drive&sensor=imu&sensor=gnss:noise_m=0.5,outage_from_s=5,outage_until_s=15
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Pose
from ispom.settings import Range
from ispom.types import Measurement, Sensor

LEVEL_FROM_VEHICLE = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""Right, down, ahead of ahead, left, up."""


class Scene(Protocol):
    """What a laser scanner sees."""

    @property
    def caster(self) -> Any:
        """Its `hits(origins, directions)` returns the triangle (N,) that each ray hits, negative for none."""
        ...

    @property
    def triangles(self) -> NDArray[Any]:
        """(T, 3, 3) corners [m]."""
        ...


@dataclass(frozen=True, eq=False)
class Scenery:
    """What sensors measure in. The y axis of the world points down."""

    pose_at: Callable[[int], Pose]
    """world_from_rig at a time [ns]."""
    frames_ns: NDArray[np.int64]
    """Times of the frames."""
    scene: Callable[[], Scene]
    seed: int

    def times_ns(self, rate_hz: float) -> NDArray[np.int64]:
        """Returns times from the first frame to the last one."""
        first, last = self.frames_ns[[0, -1]]
        return first + np.rint(np.arange(int((last - first) * 1e-9 * rate_hz) + 1) * 1e9 / rate_hz).astype(np.int64)

    def random(self, name: str) -> np.random.Generator:
        """Returns a generator that depends on the seed and the sensor."""
        return np.random.default_rng([self.seed, *name.encode()])


class SimulatedSensor(Protocol):
    """A frozen dataclass of plain values."""

    name: ClassVar[str]

    def sensor(self) -> Sensor:
        """Returns the entry of the rig."""
        ...

    def measured(self, scenery: Scenery) -> Iterator[Measurement]:
        """Yields what it measures, in the order of time."""
        ...


@dataclass(frozen=True, kw_only=True)
class SensorFaults:
    """Settings of all simulated sensors: a late clock, and an outage."""

    late_ms: Annotated[float, Range(-1000, 1000)] = 0.0
    """Its time stamps are later than the true times by this [ms]."""
    outage_from_s: Annotated[float, Range(0, 3600)] = 0.0
    """Begin of an outage, after the first frame [s]."""
    outage_until_s: Annotated[float, Range(0, 3600)] = 0.0
    """End of the outage [s]; there is none where it does not end after its begin."""

    def stamps_ns(self, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Returns time stamps of true times."""
        return times_ns + round(1e6 * self.late_ms)

    def works(self, scenery: Scenery, time_ns: int) -> bool:
        """Checks that there is no outage at a true time."""
        since_s = (time_ns - int(scenery.frames_ns[0])) * 1e-9
        return not self.outage_from_s <= since_s < self.outage_until_s
