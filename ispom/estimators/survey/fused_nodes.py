"""The state of `fused`, and how its next node is made from the measurements of the sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ispom.estimators.survey.fused_noise import Growth, grown, stated_noise
from ispom.estimators.survey.fused_values import Prior
from ispom.geometry import Array, Pose
from ispom.persistent_list import PersistentList
from ispom.sensors.fusion import MotionNoise, Node, NodeContext, motion_in_rig
from ispom.sensors.imu import inertial_of, predicted
from ispom.sensors.kind import SensorKind
from ispom.types import ClockOffset, Kind, Measurement, Rig, Status, Step

RECENT = 150
"""Poses of the images that are kept."""
KEPT_NS = 500_000_000
"""Measurements are kept until they are older than the last node by this."""


@dataclass(frozen=True, eq=False)
class FusedState:
    """The window, measurements that wait for the next node, and nodes that left the window."""

    sensors: frozenset[Kind] = frozenset()
    nodes: tuple[Node, ...] = ()
    prior: Prior | None = None
    """None until the start."""
    covariance: Array | None = None
    """(6, 6) of the last node's pose."""
    seen: tuple[tuple[int, Pose], ...] = ()
    """(time_ns, world_from_camera) of recent images, as known now."""
    memory: Mapping[Kind, Any] = field(default_factory=dict)
    """By kind of sensor, measurements that wait for the next node."""
    first: Prior | None = None
    """The prior of the start."""
    settled: PersistentList[Node] = PersistentList()
    """Nodes that left the window."""
    frames: PersistentList[tuple[int, int, Pose]] = PersistentList()
    """(time_ns, number of the node before, camera_of_node_from_camera) of all frames with a pose."""
    last_ns: int | None = None
    number: int = 0
    """Number of the next node."""
    fresh: bool = False
    """The world of the images is another one than at the last node."""
    growth: Growth | None = None
    """Growth of the images' own uncertainty, in their present world; None as long as they state none."""
    noise: MotionNoise | None = None
    """Noise of the motions of the images; None as long as they state none."""
    clock: ClockOffset | None = None
    """Clock offset of the IMU, as last estimated."""


class Collector:
    """Keeps measurements, and makes nodes of them."""

    def __init__(
        self,
        rig: Rig,
        kinds: Sequence[SensorKind],
        camera_from_rig: Pose,
        rig_from_body: Pose,
        slip: float,
        noise: MotionNoise,
    ) -> None:
        self._rig, self._kinds, self._slip, self._noise = rig, {kind.name: kind for kind in kinds}, slip, noise
        self._camera_from_rig, self._rig_from_body = camera_from_rig, rig_from_body

    def waiting(self, state: FusedState, measurement: Measurement) -> FusedState:
        """Returns the state with a measurement of a sensor of the scheme."""
        kind = self._kinds.get(measurement.kind)
        if kind is None or not isinstance(measurement, kind.measurement):
            return state
        start_ns = state.nodes[-1].time_ns if state.nodes else measurement.time_ns
        oldest_ns = min(start_ns, measurement.time_ns) - KEPT_NS
        memory = kind.remembered(state.memory.get(kind.name), measurement, oldest_ns)
        return replace(state, memory={**state.memory, kind.name: memory})

    def needs_node(self, state: FusedState) -> bool:
        """Checks whether a measurement waits that has a node of its own."""
        return any(kind.makes_nodes and state.memory.get(name) for name, kind in self._kinds.items())

    def with_images(self, state: FusedState, visual: Step) -> FusedState:
        """Keeps the poses of the images, as the visual method revised them."""
        seen = {} if visual.restarted else dict(state.seen)
        known = seen.keys() | {visual.time_ns}
        seen |= {t: pose for t, pose in visual.revised.items() if t in known or not state.seen}
        if visual.world_from_frame is not None and visual.status is Status.TRACKING:
            seen[visual.time_ns] = visual.world_from_frame
        fresh = state.fresh or visual.restarted
        growth = grown(None if visual.restarted else state.growth, visual)
        before = None if visual.restarted else state.noise
        noise = stated_noise(growth, visual, before or self._noise) or before
        state = replace(state, growth=growth, noise=noise, fresh=fresh)
        return replace(state, seen=tuple(sorted(seen.items()))[-RECENT:])

    def next_node(self, state: FusedState, time_ns: int) -> tuple[FusedState, Node]:
        """Returns the state after a new node, and the node."""
        camera, started = dict(state.seen).get(time_ns), state.prior is not None
        last = state.nodes[-1] if state.nodes else None
        # The images may have revised where they were at the last node.
        start = None if last is None else dict(state.seen).get(last.time_ns)
        visual = start.inverse() @ camera if start is not None and camera is not None else None
        moved = None
        if visual is not None and last is not None:
            moved = motion_in_rig(visual, last.log_scale, self._camera_from_rig)
        images = state.seen, camera, moved, self._camera_from_rig
        at = NodeContext(self._rig, frozenset(self._kinds), time_ns, last, started, *images, self._slip)
        observed, memory = dict[str, dict[Kind, Any]](relative={}, absolute={}), dict[Kind, Any]()
        for name, kind in self._kinds.items():
            observation, memory[name] = kind.observed(state.memory.get(name), at)
            if observation is not None and kind.measures is not None:
                observed[kind.measures][name] = observation
        after = replace(state, number=state.number + 1, memory=memory, fresh=False)
        node = Node(
            state.number,
            time_ns,
            camera=camera,
            visual=visual,
            noise=state.noise,
            relative=observed["relative"],
            absolute=observed["absolute"],
        )
        if last is None:
            return after, node
        fresh = state.fresh or (camera is not None and last.camera is None and visual is None)
        node = replace(node, log_scale=last.log_scale, bias=last.bias, offsets=last.offsets, fresh=fresh)
        return after, self._predicted(last, node, moved) if started else node

    def _predicted(self, last: Node, node: Node, moved: Pose | None) -> Node:
        """Returns the node with a first estimate from the last one."""
        seconds, inertial = (node.time_ns - last.time_ns) * 1e-9, inertial_of(node)
        by_imu = None if inertial is None else predicted(last, inertial, self._rig_from_body)
        if moved is not None:
            pose = last.local_from_rig @ moved
        elif node.link is not None:
            pose = last.local_from_rig @ node.link.relative
        else:
            pose = last.local_from_rig if by_imu is None else by_imu[0]
        if by_imu is not None:
            return replace(node, local_from_rig=pose, velocity=by_imu[1])
        places = [(each @ self._rig_from_body).translation for each in (last.local_from_rig, pose)]
        return replace(node, local_from_rig=pose, velocity=(places[1] - places[0]) / seconds)
