"""Images fused with other sensors: the schemes of the paper's Table 2, as a factor graph over a window.

1. Nodes: every `node_s` seconds, and at each fix, the graph has a pose (`fused_links`: what was measured in between).
2. Start: scale, gravity and heading from the first metres (`fused_start`).
3. Graph: relative poses of the visual method (loose coupling) with a scale that changes slowly, preintegrated IMU,
   positions of the antenna, wheels, matched scans (`fused_graph`); Forster et al. 2017, Dellaert and Kaess 2017.
4. What leaves the window stays as a prior; the same without each sensor shows how much it contributes.

Schemes 1 and 2 differ by the grade of the IMU, which the rig's noise states: the graph is the same. While the
recording goes on, the window is estimated; at the end all nodes are, with the final poses of the images.

Limits: coupling is loose, the noise of the images is a setting, and neither clocks nor places of sensors in the rig are
estimated: what contradicts is named by its misfit. Scans are taken to see vertical walls. Figures of each scheme are in
docs/methods/notes/fused.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec
from types import MappingProxyType

import numpy as np

from ispom.errors import InputError
from ispom.estimator import VIDEO, Method, require_frame
from ispom.estimators.survey.fused_checks import (
    CHECKS,
    FITS,
    GAINS,
    LOCATED,
    MAX_FIT,
    MIN_GAIN,
    SLIP,
    START_SIGMA,
    STARTED,
)
from ispom.estimators.survey.fused_graph import GAUGE, Graph
from ispom.estimators.survey.fused_nodes import Collector, FusedState
from ispom.estimators.survey.fused_settings import OTHERS, SCHEMES, FusedSettings
from ispom.estimators.survey.fused_start import OPTICAL_FROM_LEVEL, fix_checks, started
from ispom.estimators.survey.fused_values import Noise, revised_nodes
from ispom.geometry import Pose
from ispom.settings import checked
from ispom.stopwatch import Stopwatch
from ispom.types import Decision, Kind, Landmarks, Measurement, Rig, Status, Step, Trajectory

WAITING_NODES = 80
"""Nodes that are kept until the start."""
SOONEST_S = 0.08
"""Between a node and one for a fix."""
WORST_SCALE = 0.1
"""Standard deviation of the log scale with which the start is accepted."""
WORLD_FROM_LOCAL = Pose(OPTICAL_FROM_LEVEL)
"""x east, y down, z north."""


@dataclass(frozen=True)
class FusedConfig(FusedSettings):
    """Settings of `fused`."""

    def build(self, rig: Rig) -> Fused:
        """Returns the estimator. Raises InputError without a sensor of the scheme, or without gtsam."""
        return Fused(rig, checked(self), "fused", "video")


class Fused:
    """An Integrator of a visual method, which it calls `visual`."""

    others: Mapping[Kind, str] = MappingProxyType(OTHERS)
    """The sensors besides the images, each with its name."""

    def __init__(self, rig: Rig, config: FusedConfig, name: str, kind: Kind) -> None:
        known = frozenset(kind for kind in self.others if rig.has(kind))
        self._sensors = known if config.scheme == "auto" else SCHEMES[config.scheme]
        if missing := [self.others[k] for k in self.others if k in self._sensors - known]:
            raise InputError(
                f"{name}: scheme {config.scheme} needs {' and '.join(missing)}, which this sequence lacks: add it by "
                f"--sensors FILE.yaml, or choose --{name}.scheme auto"
            )
        for module, needed in (("gtsam", True), ("small_gicp", "laser" in self._sensors)):
            if needed and find_spec(module) is None:
                raise InputError(f"{name} needs {module}, of the extra `fusion`: run pip install 'ispom[fusion]'")
        self._rig, self._config, self._kind, self._metric = rig, config, kind, kind != "video"
        self._camera_from_rig = rig.rig_from("rig" if self._metric else "video").inverse()
        noise = Noise(np.radians(config.turn_deg), 0.01 * config.translation_percent, 0.01 * config.scale_percent)
        self._graph = Graph(rig, self._sensors, self._camera_from_rig, noise)
        frames = self._camera_from_rig, self._graph.rig_from_body
        self._collector = Collector(rig, self._sensors, *frames, 0.01 * config.slip_percent)

    def start(self) -> FusedState:
        """See Integrator."""
        return FusedState(self._sensors)

    def step(
        self, state: FusedState, measurement: Measurement, inputs: Mapping[str, Step], /
    ) -> tuple[FusedState, Step]:
        """See Integrator. Other measurements wait for the next frame."""
        watch = Stopwatch()
        if measurement.kind in OTHERS:
            state = self._collector.waiting(state, measurement)
            status = Status.INITIALISING if state.prior is None else Status.TRACKING
            watch.lap("wait")
            return state, Step(measurement.time_ns, status, seconds=watch.seconds)
        frame, visual = require_frame(measurement, frozenset({self._kind}), state.last_ns, self._rig), inputs["visual"]
        if state.sensors != self._sensors:
            state = self._with_other_sensors(state)
        state = replace(self._collector.with_images(state, visual), last_ns=frame.time_ns)
        sighted = bool(state.seen) and state.seen[-1][0] == frame.time_ns
        watch.lap("wait")
        if not self._due(state, frame.time_ns, sighted):
            state, step = self._between(state, frame.time_ns, sighted)
        elif state.prior is None:
            state, step = self._waiting_for_start(state, frame.time_ns, watch)
        else:
            state, step = self._with_node(state, frame.time_ns, watch)
        shown = self._landmarks(state, visual, step.world_from_frame)
        step = replace(step, tracks=visual.tracks, landmarks=shown, residuals_px=visual.residuals_px)
        return state, replace(step, seconds=watch.seconds)

    def _landmarks(self, state: FusedState, visual: Step, world_from_rig: Pose | None) -> Landmarks:
        """Returns the points of the images, carried by the pose and the scale of now."""
        camera = dict(state.seen).get(visual.time_ns)
        if world_from_rig is None or camera is None or not state.nodes:
            return Landmarks.empty()
        xyz = np.exp(state.nodes[-1].log_scale) * camera.inverse().apply(visual.landmarks.xyz_in_world)
        onto = world_from_rig @ self._camera_from_rig.inverse()
        return replace(visual.landmarks, xyz_in_world=onto.apply(xyz))

    def _due(self, state: FusedState, time_ns: int, sighted: bool) -> bool:
        """Checks that the frame becomes a node."""
        if not state.nodes or state.prior is None:
            first = not state.nodes or time_ns - state.nodes[-1].time_ns >= 1e9 * self._config.node_s
            return sighted and (first or bool(state.fixes))
        since_s = (time_ns - state.nodes[-1].time_ns) * 1e-9
        return since_s >= self._config.node_s or (bool(state.fixes) and since_s >= SOONEST_S)

    def _between(self, state: FusedState, time_ns: int, sighted: bool) -> tuple[FusedState, Step]:
        """A frame between two nodes: its pose comes from the last node and the images."""
        start = dict(state.seen).get(state.nodes[-1].time_ns) if state.nodes else None
        if not sighted or start is None:
            waits = state.prior is None
            return state, Step(time_ns, Status.INITIALISING if waits else Status.LOST, decisions=(LOCATED.of(0, 1),))
        last, relative = state.nodes[-1], start.inverse() @ dict(state.seen)[time_ns]
        state = replace(state, frames=state.frames.appended((time_ns, last.number, relative)))
        if state.prior is None or state.covariance is None:
            return state, Step(time_ns, Status.INITIALISING, decisions=(LOCATED.of(1, 1),))
        moved = self._collector.in_rig(relative, last.log_scale)
        along = moved.inverse().adjoint
        length, seconds = float(np.linalg.norm(moved.translation)), (time_ns - last.time_ns) * 1e-9
        covariance = along @ state.covariance @ along.T + self._graph.noise.covariance(length, seconds)
        pose = WORLD_FROM_LOCAL @ last.local_from_rig @ moved
        decisions = (LOCATED.of(1, 1),)
        return state, Step(time_ns, Status.TRACKING, "rig", pose, covariance, decisions=decisions)

    def _waiting_for_start(self, state: FusedState, time_ns: int, watch: Stopwatch) -> tuple[FusedState, Step]:
        """Adds a node, and starts the graph once enough was measured."""
        if state.fresh:
            state = replace(state, nodes=(), walls=None)
        state, node, _ = self._collector.next_node(state, time_ns)
        state = replace(state, nodes=(*state.nodes, node)[-WAITING_NODES:])
        state = replace(state, frames=state.frames.appended((time_ns, node.number, Pose())))
        watch.lap("measure")
        nodes = revised_nodes(state.nodes, dict(state.seen))
        frames = self._camera_from_rig, self._graph.rig_from_body
        known = self._metric or not self._sensors  # images alone keep their unit
        start = started(nodes, *frames, "gnss" in self._sensors, known, self._config.start_m)
        decisions = (LOCATED.of(1, 1), STARTED.of(len(nodes), WAITING_NODES, passed=start is not None))
        if start is None:
            missing = fix_checks(nodes, self._config.start_m) if "gnss" in self._sensors else ()
            decisions += tuple(check for check in missing if not check.passed)
            return replace(state, nodes=nodes), Step(time_ns, Status.INITIALISING, decisions=decisions)
        prior = self._graph.first_prior(
            start.nodes[0],
            self._graph.first_covariance(start.nodes[0].local_from_rig, self._config.tilt_deg),
            start.scale_sigma,
        )
        waiting = replace(state, nodes=nodes)
        nodes, misfits = self._graph.optimised(start.nodes, prior)
        certain = START_SIGMA.of(self._graph.uncertainty(nodes, prior)[1], WORST_SCALE)
        watch.lap("optimise")
        if self._sensors and not certain.passed:
            count = STARTED.of(len(nodes), WAITING_NODES, passed=False)
            return waiting, Step(time_ns, Status.INITIALISING, decisions=(LOCATED.of(1, 1), count, certain))
        state = replace(state, nodes=nodes, prior=prior, first=prior, walls=None)
        return self._reported(state, decisions, misfits, watch)

    def _with_node(self, state: FusedState, time_ns: int, watch: Stopwatch) -> tuple[FusedState, Step]:
        """Adds a node to the graph, and estimates the window."""
        state, node, apart = self._collector.next_node(state, time_ns)
        sources = sum(each is not None for each in (node.visual, node.inertial, node.wheel, node.laser))
        decisions = [LOCATED.of(sources, 1)]
        if apart is not None:
            decisions.append(SLIP.of(apart, 0.01 * self._config.slip_percent))
        watch.lap("measure")
        assert state.prior is not None
        nodes, misfits = self._graph.optimised(revised_nodes((*state.nodes, node), dict(state.seen)), state.prior)
        watch.lap("optimise")
        state = replace(state, nodes=nodes, frames=state.frames.appended((time_ns, node.number, Pose())))
        return self._reported(state, tuple(decisions), misfits, watch)

    def _reported(
        self, state: FusedState, decisions: tuple[Decision, ...], misfits: Mapping[str, float], watch: Stopwatch
    ) -> tuple[FusedState, Step]:
        """Returns the Step of the last node, and the window without the nodes that are too many."""
        nodes, prior, settled = state.nodes, state.prior, state.settled
        assert prior is not None
        last = nodes[-1]
        covariance, scale_sigma, gains = self._graph.uncertainty(nodes, prior)
        revised = Trajectory.of([(n.time_ns, WORLD_FROM_LOCAL @ n.local_from_rig) for n in nodes[:-1]])
        while len(nodes) > self._config.window:
            prior = self._graph.reduced(nodes, prior)
            leaving, *others = nodes
            settled = settled.appended(leaving)
            nodes = tuple(others)
        watch.lap("marginalise")
        fits = [FITS[sensor].of(value, MAX_FIT) for sensor, value in misfits.items()]
        gain = [GAINS[sensor].of(value, MIN_GAIN) for sensor, value in gains.items()]
        located = not last.blind or state.covariance is None
        state = replace(state, nodes=nodes, prior=prior, settled=settled, covariance=covariance)
        return state, Step(
            last.time_ns,
            Status.TRACKING if located else Status.LOST,
            "rig",
            WORLD_FROM_LOCAL @ last.local_from_rig if located else None,
            covariance if located else None,
            key_frame=True,
            revised=revised,
            scale=None if self._metric else float(np.exp(last.log_scale)),
            scale_sigma=scale_sigma,
            decisions=(*decisions, *fits, *gain),
        )

    def finish(self, state: FusedState, inputs: Mapping[str, Trajectory], /) -> Trajectory:
        """See Integrator: all nodes since the start estimated at once, and the frames between by the images, each with
        the final poses of the images."""
        final = dict(inputs["visual"].items())
        nodes = [*state.settled, *(state.nodes if state.prior is not None else ())]
        if state.first is not None:
            older = [n for n in nodes if n.number < state.first.at.number]
            together = revised_nodes(tuple(n for n in nodes if n.number >= state.first.at.number), final)
            nodes = [*older, *self._graph.optimised(together, state.first)[0]]
        by_number, found = {node.number: node for node in nodes}, list[tuple[int, Pose]]()
        for time_ns, number, relative in state.frames:
            if (node := by_number.get(number)) is not None:
                both = time_ns in final and node.time_ns in final
                seen = final[node.time_ns].inverse() @ final[time_ns] if both else relative
                moved = self._collector.in_rig(seen, node.log_scale)
                found.append((time_ns, WORLD_FROM_LOCAL @ node.local_from_rig @ moved))
        return Trajectory.of(found)

    def _with_other_sensors(self, state: FusedState) -> FusedState:
        """Goes on from the last pose after a change of the scheme."""
        bare = replace(self.start(), settled=state.settled, frames=state.frames, seen=state.seen, last_ns=state.last_ns)
        if state.covariance is None or not state.nodes:
            return replace(bare, number=state.number)
        settled = state.settled.extended(state.nodes[:-1])
        last = replace(state.nodes[-1], fixes=(), bias=np.zeros(6))
        prior = self._graph.first_prior(last, state.covariance + GAUGE**2 * np.eye(6), 0.1)
        bare = replace(bare, nodes=(last,), prior=prior, first=prior, covariance=state.covariance, settled=settled)
        return replace(bare, number=state.number)


METHOD = Method(
    "fused",
    VIDEO | frozenset(OTHERS),
    FusedConfig,
    "metric",
    "Forster et al. 2017 (preintegrated IMU), Dellaert and Kaess 2017 (factor graphs)",
    "m per unit",
    {"visual": "monocular"},
    CHECKS,
    {
        "wait": "Keeps what the sensors measured until the next node.",
        "measure": "Makes relative poses of it: samples, wheels, scans.",
        "optimise": "Estimates all nodes of the window.",
        "marginalise": "Gives the covariance, and takes the oldest node out.",
    },
    frozenset(OTHERS),
    "Table 2: images and other sensors",
    "own",
)
