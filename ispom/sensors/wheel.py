"""Wheel odometers: the distance that wheels rolled since the measurement before, and perhaps the rotation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Pose
from ispom.plausibility import Doubt
from ispom.plausibility.times import Rates
from ispom.plausibility.wheel import wheel_doubts
from ispom.sensors.fusion import FLOOR_M, FLOOR_RAD, Factor, GraphFrames, Link, Node, NodeContext, link_in_rig
from ispom.sensors.kind import FileOptions, Readings, SensorKind, Table
from ispom.sensors.simulated import LEVEL_FROM_VEHICLE, Scenery, SensorFaults
from ispom.settings import Range
from ispom.types import Check, Measurement, WheelIncrement, WheelOdometer

OUT_OF_PLANE = 0.02
"""Standard deviation of height relative to the distance, and of roll and pitch [rad], within a link of wheels: of a
vehicle on an uneven road."""
SIDEWAYS = 0.01
"""The same of the sideways motion of wheels that roll."""
FREE_RAD = 0.1
"""Standard deviation of the rotation that one wheel does not measure [rad]."""
SLIP_SIGMAS = 3.0
"""Standard deviations of the wheels up to which a difference from the images is no slip."""
STEP_NS = 5_000_000
"""Simulated wheels roll straight within this time."""
SLIP = Check(
    "wheel_slip",
    "way of the wheels that the images do not confirm",
    "warning",
    relation="<=",
    passes="The wheels roll: their way differs by {value:.0%} from that of the images (limit {threshold:.0%}).",
    fails="The wheels slip: {value:.0%} of their way is not confirmed by the images (limit {threshold:.0%}); ignored.",
)


@dataclass(frozen=True, kw_only=True)
class SimulatedWheel(SensorFaults):
    """A pair of wheels with encoders below the rig's origin, as of a differential drive."""

    name: ClassVar[str] = "wheel"
    rate_hz: Annotated[float, Range(1, 200)] = 20.0
    """Increments per second."""
    noise: Annotated[float, Range(0, 100)] = 1.0
    """Factor of the noise: 1 is 0.01 m and 0.01 rad (1 sigma) in the first metre, growing with the root of the way."""
    bias: Annotated[float, Range(-0.5, 0.5)] = 0.0
    """Share by which all distances are too long, as of a wheel with too little air."""
    slip: Annotated[float, Range(-1, 10)] = 0.0
    """Share by which distances are too long while the wheels slip; -1: they are blocked."""
    slip_from_s: Annotated[float, Range(0, 3600)] = 0.0
    """Begin of the slip, after the first frame [s]."""
    slip_until_s: Annotated[float, Range(0, 3600)] = 3600.0
    """End of the slip [s]."""
    pair: bool = True
    """Also measures the rotation; otherwise one wheel is measured (a distance measuring instrument)."""
    arm_m: Annotated[float, Range(-10, 10)] = 1.6
    """Lever arm: how far the wheels are below the rig's origin [m]."""

    def sensor(self) -> WheelOdometer:
        return WheelOdometer(rig_from_sensor=Pose(LEVEL_FROM_VEHICLE, np.array([0.0, self.arm_m, 0.0])))

    def measured(self, scenery: Scenery) -> Iterator[Measurement]:
        odometer, rng = self.sensor(), scenery.random(self.name)
        times_ns = scenery.times_ns(self.rate_hz)
        for since_ns, time_ns in pairwise(times_ns.tolist()):
            way, turn = rolled(scenery.pose_at, since_ns, time_ns, odometer.rig_from_sensor)
            noise = self.noise * np.sqrt(abs(way)) * rng.normal(size=2)
            if not (self.works(scenery, since_ns) and self.works(scenery, time_ns)):
                continue
            since_s = (since_ns - int(scenery.frames_ns[0])) * 1e-9
            slip = self.slip if self.slip_from_s <= since_s < self.slip_until_s else 0.0
            distance = way * (1 + self.bias + slip) + odometer.distance_noise * noise[0]
            turned = turn + odometer.rotation_noise_rad * noise[1] if self.pair else None
            stamps = self.stamps_ns(np.array([since_ns, time_ns])).tolist()
            yield WheelIncrement(stamps[1], stamps[0], float(distance), turned, self.name)


def rolled(pose_at: Callable[[int], Pose], since_ns: int, until_ns: int, rig_from_wheel: Pose) -> tuple[float, float]:
    """Returns the way [m] along the odometer's x axis, and the rotation [rad] about its z axis."""
    count = max(1, round((until_ns - since_ns) / STEP_NS))
    times_ns = np.linspace(since_ns, until_ns, count + 1).astype(np.int64)
    poses = [pose_at(t) @ rig_from_wheel for t in times_ns.tolist()]
    twists = np.array([(a.inverse() @ b).log() for a, b in pairwise(poses)]).sum(axis=0)
    return float(twists[0]), float(twists[5])


def wheel_link(
    increments: Sequence[WheelIncrement], start_ns: int, end_ns: int, odometer: WheelOdometer, turned: float | None
) -> tuple[Link, float] | None:
    """Returns the motion of the rig by its wheels, and their way [m]; None where they did not measure all the time.

    `turned`: rotation about the axis of the wheels [rad], where one wheel is measured only.
    """
    pose, covered_ns, way, known = Pose(), 0, 0.0, True
    for n, each in enumerate(increments):
        length = each.time_ns - each.since_ns
        # The last increment goes on to the node: the next one is not measured yet.
        late = n == len(increments) - 1 and 0 < end_ns - each.time_ns <= 1.5 * length
        overlap = (end_ns if late else min(end_ns, each.time_ns)) - max(start_ns, each.since_ns)
        if overlap <= 0:
            continue
        share = overlap / (each.time_ns - each.since_ns)
        known &= each.turned_rad is not None
        rate = (turned or 0.0) * overlap / (end_ns - start_ns)
        turn = rate if each.turned_rad is None else share * each.turned_rad
        half = Pose.from_rotvec(np.array([0.0, 0.0, 0.5 * turn]), np.zeros(3))
        pose = pose @ half @ Pose(translation=np.array([share * each.distance_m, 0.0, 0.0])) @ half
        covered_ns += overlap
        way += share * each.distance_m
    if covered_ns < 0.95 * (end_ns - start_ns) or (not known and turned is None):
        return None
    length = abs(way)
    turn_variance = FREE_RAD**2 if not known else odometer.rotation_noise_rad**2 * length + FLOOR_RAD**2
    variances = [
        odometer.distance_noise**2 * length + FLOOR_M**2,
        (SIDEWAYS * length) ** 2 + 0.25 * turn_variance * way**2 * known + FLOOR_M**2,
        (OUT_OF_PLANE * length) ** 2 + FLOOR_M**2,
        OUT_OF_PLANE**2,
        OUT_OF_PLANE**2,
        turn_variance,
    ]
    return link_in_rig(pose, np.diag(variances), odometer.rig_from_sensor), way


class WheelKind(SensorKind):
    """A measured wheel, or a pair of wheels."""

    name, label, phrase, order = "wheel", "Wheels", "a wheel odometer", 3
    sensor, measurement, simulated = WheelOdometer, WheelIncrement, SimulatedWheel
    rates = Rates((0.2, 5_000.0), (0.5, 1_000.0))
    measures, checks = "relative", (SLIP,)

    def readings(self, table: Table, options: FileOptions) -> Readings:
        values = {"distances": table.stacked(("distance",))[1:, 0]}
        values |= {"turns": table.columns["turn"][1:]} if "turn" in table.columns else {}
        return Readings(self.name, table.times_ns, values, between=True)

    def collected(self, measured: Sequence[WheelIncrement]) -> Readings:
        values = {"distances": np.array([m.distance_m for m in measured])}
        turns = [m.turned_rad for m in measured if m.turned_rad is not None]
        values |= {"turns": np.array(turns)} if len(turns) == len(measured) else {}
        times_ns = np.array([measured[0].since_ns, *(m.time_ns for m in measured)], np.int64)
        return Readings(self.name, times_ns, values, between=True)

    def measurements(self, found: Readings, frames_ns: NDArray[np.int64], name: str) -> Iterator[WheelIncrement]:
        times_ns, turns = found.times_ns, found.values.get("turns")
        for i in np.flatnonzero(found.within(frames_ns)).tolist():
            turn = None if turns is None else float(turns[i])
            yield WheelIncrement(
                int(times_ns[i + 1]), int(times_ns[i]), float(found.values["distances"][i]), turn, name
            )

    def doubts(self, where: str, found: Readings) -> tuple[Doubt, ...]:
        return wheel_doubts(where, found.times_ns, found.values["distances"], found.values.get("turns"))

    def observed(self, memory: Any, at: NodeContext) -> tuple[Link | None, Any]:
        if at.last is None:
            return None, memory
        odometer, by_images = at.sensor(WheelOdometer), None
        if at.moved is not None:
            by_images = odometer.rig_from_sensor.inverse() @ at.moved @ odometer.rig_from_sensor
        turned = None if by_images is None else float(by_images.rotvec[2])
        found = wheel_link(memory or (), at.last.time_ns, at.time_ns, odometer, turned)
        if found is None:
            return None, memory
        link, way = found
        if by_images is None or not at.started:
            return link, memory
        # A standing rig: what the deviations explain is no slip.
        length = float(by_images.translation[0])
        least = SLIP_SIGMAS * np.hypot(odometer.distance_noise * np.sqrt(max(abs(length), 0.01)), 0.002)
        gap = max(0.0, abs(way - length) - least)
        slip = SLIP.of(gap / max(abs(length), abs(way), 0.02), at.slip)
        return replace(link, trusted=slip.passed, decisions=(slip,)), memory

    def factors(self, before: Node | None, now: Node, frames: GraphFrames) -> list[Factor]:
        link = now.relative.get(self.name)
        if before is None or link is None or not link.trusted:
            return []
        return [frames.relative_pose(self.name, link, before, now)]


KIND = WheelKind()
