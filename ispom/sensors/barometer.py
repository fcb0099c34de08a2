"""Barometers: heights by the pressure of the air, with an offset that changes slowly with the weather.

A height is that of the sensor above any level [m]. The graph of `fused` estimates the offset from there to the local
frame, which is a random walk. Reference for the pressure: U.S. Standard Atmosphere 1976, troposphere.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from ispom.geometry import Array, Pose, skew
from ispom.plausibility.times import Rates
from ispom.sensors.fusion import POSE, Factor, GraphFrames, Node, NodeContext, Offset
from ispom.sensors.kind import FileOptions, Readings, SensorKind, Table
from ispom.sensors.simulated import Scenery, SensorFaults
from ispom.settings import Range
from ispom.types import Measurement, Sensor

SEA_LEVEL_PA, SCALE_M, EXPONENT = 101_325.0, 44_330.8, 0.190263
NEAR_S = 0.05
"""Largest time from a reading to the node to which it belongs [s]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Barometer(Sensor):
    """The entry in the rig."""

    kind: ClassVar[str] = "barometer"
    height_noise_m: float = 0.3
    """Standard deviation of a height [m]."""
    drift_m: float = 0.02
    """Change of the offset within a second (1 sigma), growing with the root of the time [m/sqrt(s)]."""


@dataclass(frozen=True, eq=False)
class Height(Measurement):
    """A height by the pressure of the air."""

    height_m: float
    """Above any level, plus a slowly changing offset."""
    sensor: str = "barometer"
    """Name of the barometer in the rig."""

    def __post_init__(self) -> None:
        """Raises ValueError where the height is not finite."""
        if not np.isfinite(self.height_m):
            raise ValueError("a height must be finite")

    @property
    def kind(self) -> str:
        return "barometer"


@dataclass(frozen=True, kw_only=True)
class SimulatedBarometer(SensorFaults):
    """A barometer as in a phone, at the rig's origin."""

    name: ClassVar[str] = "barometer"
    rate_hz: Annotated[float, Range(0.1, 100)] = 10.0
    """Heights per second."""
    noise_m: Annotated[float, Range(0, 100)] = 0.3
    """Standard deviation of a height [m]."""
    drift_m: Annotated[float, Range(0, 10)] = 0.02
    """Change of the offset within a second (1 sigma), growing with the root of the time [m/sqrt(s)]."""
    level_m: Annotated[float, Range(-1000, 10_000)] = 430.0
    """Height of the world's origin [m]."""

    def sensor(self) -> Barometer:
        return Barometer(height_noise_m=max(self.noise_m, 1e-3), drift_m=max(self.drift_m, 1e-6))

    def measured(self, scenery: Scenery) -> Iterator[Measurement]:
        rng, times_ns = scenery.random(self.name), scenery.times_ns(self.rate_hz)
        walk, noise = rng.normal(size=(2, len(times_ns)))
        errors = self.drift_m / np.sqrt(self.rate_hz) * np.cumsum(walk) + self.noise_m * noise
        for true_ns, stamp_ns, error in zip(times_ns.tolist(), self.stamps_ns(times_ns).tolist(), errors, strict=True):
            if self.works(scenery, true_ns):
                height_m = self.level_m - scenery.pose_at(true_ns).translation[1] + error
                yield Height(stamp_ns, float(height_m), self.name)


def _first_offset(node: Node) -> Array:
    """Returns the offset of a node by its own height, or by none."""
    height_m = node.absolute.get(KIND.name)
    return np.array([0.0 if height_m is None else height_m - node.local_from_rig.translation[2]])


OFFSET = Offset("barometer", "h", 1, sigma=1e4, first=_first_offset)


class BarometerKind(SensorKind):
    """A barometer: tables have a column `height_m`, or `pressure_pa`."""

    name, label, phrase, order = "barometer", "Barometer", "a barometer", 5
    sensor, measurement, simulated = Barometer, Height, SimulatedBarometer
    rates = Rates((0.05, 1000.0), (0.5, 200.0))
    measures, tightly, variables = "absolute", True, (OFFSET,)

    def readings(self, table: Table, options: FileOptions) -> Readings:
        if not table.has(("pressure_pa",)):
            return super().readings(table, options)
        ratio = table.stacked(("pressure_pa",))[:, 0] / SEA_LEVEL_PA
        return Readings(self.name, table.times_ns, {"height_m": SCALE_M * (1 - np.maximum(ratio, 0) ** EXPONENT)})

    def observed(self, memory: Any, at: NodeContext) -> tuple[float | None, Any]:
        """Returns the height at the time of the node, by the last readings before it."""
        waiting = memory or ()
        near = [m for m in waiting if 0 <= (at.time_ns - m.time_ns) * 1e-9 <= NEAR_S]
        return (near[-1].height_m if near else None), ()

    def factors(self, before: Node | None, now: Node, frames: GraphFrames) -> list[Factor]:
        import gtsam

        barometer, model, found = frames.sensor(Barometer), gtsam.noiseModel, list[Factor]()
        if before is not None:
            walk = model.Isotropic.Sigma(1, barometer.drift_m * np.sqrt((now.time_ns - before.time_ns) * 1e-9))
            drift = gtsam.BetweenFactorVector(OFFSET.key(before), OFFSET.key(now), np.zeros(1), walk)
            found.append(Factor("offset", drift, now.number))
        if (height_m := now.absolute.get(self.name)) is not None:
            place, noise = frames.point_in_body(barometer), frames.loss.noise(np.eye(1) * barometer.height_noise_m**2)
            keys = [POSE.key(now), OFFSET.key(now)]

            def error(_: gtsam.CustomFactor, values: gtsam.Values, jacobians: Any) -> Any:
                body = Pose.from_matrix(values.atPose3(keys[0]).matrix())
                if jacobians is not None:
                    up = body.rotation[2]
                    jacobians[0] = np.concatenate([-up @ skew(place), up])[None]
                    jacobians[1] = np.eye(1)
                return body.apply(place)[2] + values.atVector(keys[1]) - height_m

            found.append(Factor(self.name, gtsam.CustomFactor(noise, keys, error), now.number, 1, frames.loss))
        return found


KIND = BarometerKind()
