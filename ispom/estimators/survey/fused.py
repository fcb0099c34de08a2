"""Images fused with other sensors: the schemes of the paper's Table 2, as a factor graph over a window.

1. Nodes: every `node_s` seconds, and at each fix, the graph has a pose. Each kind of sensor (`ispom.sensors`) makes
   observations from its measurements at a node or between nodes.
2. Start: scale, gravity and heading from the first metres (`fused_start`). A pair has poses in its own world until
   fixes give the heading.
3. Graph: relative poses of the visual method (loose coupling) with a scale that changes slowly, preintegrated IMU,
   positions of the antenna, wheels, matched scans, and whatever other kinds of sensors have factors (`fused_graph`);
   Forster et al. 2017, Dellaert and Kaess 2017.
4. Nodes that leave the window stay as a prior. A second prior without a sensor shows how much the sensor contributes.

Schemes 1 and 2 differ by the grade of the IMU, which the rig's noise states: the graph is the same. While the
recording goes on, only the window is estimated; at the end all nodes are estimated, with the final poses of the images.

Limits: coupling is loose, and neither clocks nor positions of sensors in the rig are estimated; a sensor that
contradicts the others is named by its misfit. Scans are assumed to show vertical walls. Figures of each scheme are in
docs/methods/notes/fused.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np

from ispom.errors import InputError
from ispom.estimator import VIDEO, Method, require_frame
from ispom.estimators.survey.fused_checks import LOCATED, MAX_FIT, MIN_GAIN, START_SIGMA, STARTED, checks_of
from ispom.estimators.survey.fused_clock import clock_due, imu_clock
from ispom.estimators.survey.fused_graph import Graph
from ispom.estimators.survey.fused_influence import GraphProblem
from ispom.estimators.survey.fused_nodes import Collector, FusedState
from ispom.estimators.survey.fused_settings import SCHEMES, FusedSettings
from ispom.estimators.survey.fused_start import (
    CERTAIN_UNIT,
    OPTICAL_FROM_LEVEL,
    UNCERTAIN_UNIT,
    alignment,
    fix_checks,
    started,
)
from ispom.estimators.survey.fused_values import Prior, imu_of, revised_nodes
from ispom.estimators.survey.fused_window import GAUGE
from ispom.geometry import Pose
from ispom.sensors import SENSOR_KINDS
from ispom.sensors.fusion import MotionNoise, Node, motion_in_rig
from ispom.sensors.kind import SensorKind
from ispom.settings import checked
from ispom.solvers.influence.problem import report_problem
from ispom.stopwatch import Stopwatch
from ispom.types import Decision, Kind, Landmarks, Measurement, Rig, Status, Step, Trajectory

WAITING_NODES = 80
"""Nodes that are kept until the start."""
SOONEST_S = 0.08
"""Least interval between a node and a node for a fix."""
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


def usable_kinds(tightly: bool = False) -> dict[Kind, SensorKind]:
    """Returns the kinds of sensors besides images that `fused` can use, by name, or those that `fused.tight` can."""
    kinds = SENSOR_KINDS.items()
    return {name: k for name, k in kinds.items() if k.measures is not None and (k.tightly or not tightly)}


class Fused:
    """An Integrator of a visual method, which it calls `visual`."""

    tightly = False
    """Whether only those kinds of sensors take part that are coupled tightly."""
    least: frozenset[Kind] = frozenset()
    """Kinds of sensors of which it needs one at least; empty for any."""
    least_phrase = "a sensor besides the images"

    def __init__(self, rig: Rig, config: FusedConfig, name: str, kind: Kind) -> None:
        self._usable = usable = usable_kinds(self.tightly)
        known = frozenset(kind for kind in usable if rig.has(kind))
        self._sensors = known if config.scheme == "auto" else SCHEMES[config.scheme]
        kinds = [kind for kind in usable.values() if kind.name in self._sensors]
        for module in ("gtsam", *(module for kind in kinds for module in kind.needs)):
            if find_spec(module) is None:
                raise InputError(f"{name} needs {module}, of the extra `fusion`: run pip install 'ispom[fusion]'")
        if missing := [kind.phrase for kind in usable.values() if kind.name in self._sensors - known]:
            raise InputError(
                f"{name}: scheme {config.scheme} needs {' and '.join(missing)}, which this sequence lacks: add it by "
                f"--sensors FILE.yaml, or choose --{name}.scheme auto"
            )
        if not self._sensors & (self.least or self._sensors):
            raise InputError(
                f"{name} needs {self.least_phrase}, which this sequence lacks: add it by --sensors FILE.yaml; images "
                f"alone are scheme 9, the method {'stereo' if kind == 'stereo' else 'monocular'}"
            )
        self._rig, self._config, self._kind, self._metric = rig, config, kind, kind != "video"
        self._unit_sigma = None if kind == "video" else CERTAIN_UNIT if rig.pair_sigma else UNCERTAIN_UNIT
        self._camera_from_rig = rig.rig_from("rig" if self._metric else "video").inverse()
        noise = MotionNoise(np.radians(config.turn_deg), 0.01 * config.translation_percent, 0.01 * config.scale_percent)
        self._graph = Graph(rig, self._sensors, self._camera_from_rig, noise)
        frames = self._camera_from_rig, self._graph.rig_from_body
        self._collector = Collector(rig, kinds, *frames, 0.01 * config.slip_percent, noise)
        self._checks = checks_of(kinds)

    def start(self) -> FusedState:
        """See Integrator."""
        return FusedState(self._sensors)

    def step(
        self, state: FusedState, measurement: Measurement, inputs: Mapping[str, Step], /
    ) -> tuple[FusedState, Step]:
        """See Integrator. Other measurements wait for the next frame."""
        watch = Stopwatch()
        if measurement.kind in self._usable:
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
        if step.world_from_frame is not None and step.covariance is None:
            step = replace(step, covariance=visual.covariance)
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

    def _in_rig(self, relative: Pose, log_scale: float) -> Pose:
        """Returns a motion of the camera in the unit of the images as one of the rig [m]."""
        return motion_in_rig(relative, log_scale, self._camera_from_rig)

    def _due(self, state: FusedState, time_ns: int, sighted: bool) -> bool:
        """Checks that the frame becomes a node."""
        if not state.nodes or state.prior is None:
            first = not state.nodes or time_ns - state.nodes[-1].time_ns >= 1e9 * self._config.node_s
            return sighted and (first or self._collector.needs_node(state))
        since_s = (time_ns - state.nodes[-1].time_ns) * 1e-9
        return since_s >= self._config.node_s or (since_s >= SOONEST_S and self._collector.needs_node(state))

    def _between(self, state: FusedState, time_ns: int, sighted: bool) -> tuple[FusedState, Step]:
        """Returns the state and the Step of a frame between two nodes, whose pose comes from the last node and the
        images."""
        start = dict(state.seen).get(state.nodes[-1].time_ns) if state.nodes else None
        if not sighted or start is None:
            waits = state.prior is None
            return state, Step(time_ns, Status.INITIALISING if waits else Status.LOST, decisions=(LOCATED.of(0, 1),))
        last, relative = state.nodes[-1], start.inverse() @ dict(state.seen)[time_ns]
        state = replace(state, frames=state.frames.appended((time_ns, last.number, relative)))
        if state.prior is None and self._metric:
            return state, self._by_images(state, time_ns, (LOCATED.of(1, 1),))
        if state.prior is None or state.covariance is None:
            return state, Step(time_ns, Status.INITIALISING, decisions=(LOCATED.of(1, 1),))
        moved = self._in_rig(relative, last.log_scale)
        along = moved.inverse().adjoint
        noise, seconds = state.noise or self._graph.noise, (time_ns - last.time_ns) * 1e-9
        of_camera, onto = noise.covariance(relative, np.exp(last.log_scale), seconds), self._camera_from_rig.inverse()
        covariance = along @ state.covariance @ along.T + onto.adjoint @ of_camera @ onto.adjoint.T
        pose = WORLD_FROM_LOCAL @ last.local_from_rig @ moved
        decisions = (LOCATED.of(1, 1),)
        return state, Step(time_ns, Status.TRACKING, "rig", pose, covariance, decisions=decisions)

    def _waiting_for_start(self, state: FusedState, time_ns: int, watch: Stopwatch) -> tuple[FusedState, Step]:
        """Adds a node, and starts the graph once enough was measured."""
        if state.fresh:
            state = replace(state, nodes=())
        state, node = self._collector.next_node(state, time_ns)
        state = replace(state, nodes=(*state.nodes, node)[-WAITING_NODES:])
        state = replace(state, frames=state.frames.appended((time_ns, node.number, Pose())))
        watch.lap("measure")
        nodes = _with_noise(revised_nodes(state.nodes, dict(state.seen)), state.noise)
        frames = self._camera_from_rig, self._graph.rig_from_body
        start = started(nodes, *frames, "gnss" in self._sensors, self._unit_sigma, self._config.start_m)
        decisions = (LOCATED.of(1, 1), STARTED.of(len(nodes), WAITING_NODES, passed=start is not None))
        if start is None and self._metric:
            decisions = (LOCATED.of(1, 1), alignment(nodes, self._config.start_m, aligned=False))
            return replace(state, nodes=nodes), self._by_images(state, time_ns, decisions)
        if start is None:
            missing = fix_checks(nodes, self._config.start_m) if "gnss" in self._sensors else ()
            decisions += tuple(check for check in missing if not check.passed)
            return replace(state, nodes=nodes), Step(time_ns, Status.INITIALISING, decisions=decisions)
        covariance = self._graph.first_covariance(start.nodes[0].local_from_rig, np.radians(self._config.tilt_deg))
        prior = self._graph.first_prior(start.nodes[0], covariance, s=start.scale_sigma)
        waiting = replace(state, nodes=nodes)
        nodes, misfits = self._optimised(start.nodes, prior)
        certain = START_SIGMA.of(self._graph.uncertainty(nodes, prior).by_letter["s"], WORST_SCALE)
        watch.lap("optimise")
        if not certain.passed:
            count = STARTED.of(len(nodes), WAITING_NODES, passed=False)
            return waiting, Step(time_ns, Status.INITIALISING, decisions=(LOCATED.of(1, 1), count, certain))
        state = replace(state, nodes=nodes, prior=prior, first=prior)
        if not (self._metric and "gnss" in self._sensors):
            return self._reported(state, decisions, misfits, watch)
        decisions += (alignment(start.nodes, self._config.start_m, aligned=True),)
        state, step = self._reported(state, decisions, misfits, watch)
        return state, replace(step, restarted=True)  # up to here, poses were in the world of the images

    def _by_images(self, state: FusedState, time_ns: int, decisions: tuple[Decision, ...]) -> Step:
        """Returns the pose of a pair in its own world, which is metric."""
        pose = dict(state.seen)[time_ns] @ self._camera_from_rig
        return Step(time_ns, Status.TRACKING, "rig", pose, decisions=decisions)

    def _with_node(self, state: FusedState, time_ns: int, watch: Stopwatch) -> tuple[FusedState, Step]:
        """Adds a node to the graph, and estimates the window."""
        state, node = self._collector.next_node(state, time_ns)
        decisions = [LOCATED.of(node.motion_sources, 1)]
        decisions += [each for link in node.relative.values() for each in getattr(link, "decisions", ())]
        watch.lap("measure")
        assert state.prior is not None
        nodes = _with_noise(revised_nodes((*state.nodes, node), dict(state.seen)), state.noise)
        nodes, misfits = self._optimised(nodes, state.prior)
        watch.lap("optimise")
        state = replace(state, nodes=nodes, frames=state.frames.appended((time_ns, node.number, Pose())))
        return self._reported(state, tuple(decisions), misfits, watch)

    def _optimised(self, nodes: tuple[Node, ...], prior: Prior) -> tuple[tuple[Node, ...], dict[str, float]]:
        """Returns the most likely nodes, and the misfits by sensor."""
        found, misfits = self._graph.optimised(nodes, prior)
        report_problem(lambda: GraphProblem(self._graph, nodes, found, prior))
        return found, misfits

    def _reported(
        self, state: FusedState, decisions: tuple[Decision, ...], misfits: Mapping[str, float], watch: Stopwatch
    ) -> tuple[FusedState, Step]:
        """Returns the Step of the last node, and the window without the nodes that are too many."""
        nodes, prior, settled = state.nodes, state.prior, state.settled
        assert prior is not None
        last = nodes[-1]
        state = self._with_clock(state)
        uncertainty = self._graph.uncertainty(nodes, prior)
        revised = Trajectory.of([(n.time_ns, WORLD_FROM_LOCAL @ n.local_from_rig) for n in nodes[:-1]])
        while len(nodes) > self._config.window:
            prior = self._graph.reduced(nodes, prior)
            leaving, *others = nodes
            settled = settled.appended(leaving)
            nodes = tuple(others)
        watch.lap("marginalise")
        located = last.motion_sources > 0 or state.covariance is None
        state = replace(state, nodes=nodes, prior=prior, settled=settled, covariance=uncertainty.covariance)
        return state, Step(
            last.time_ns,
            Status.TRACKING if located else Status.LOST,
            "rig",
            WORLD_FROM_LOCAL @ last.local_from_rig if located else None,
            uncertainty.covariance if located else None,
            key_frame=True,
            revised=revised,
            scale=None if self._metric else float(np.exp(last.log_scale)),
            scale_sigma=uncertainty.by_letter["s"],
            calibration=imu_of(last, uncertainty.covariance, uncertainty.unknowns, state.clock),
            decisions=(*decisions, *self._sensor_decisions(misfits, uncertainty.gains)),
        )

    def _with_clock(self, state: Any) -> Any:
        """Returns the state with another estimate of the IMU's clock, where it is time for one."""
        if "imu" not in self._sensors or not clock_due(state.nodes[-1]):
            return state
        found = imu_clock((*state.settled, *state.nodes), self._camera_from_rig, self._graph.rig_from_body)
        return replace(state, clock=found or state.clock)

    def _sensor_decisions(self, misfits: Mapping[str, float], gains: Mapping[str, float]) -> list[Decision]:
        """Returns whether each sensor agrees with the others, and how much it contributes."""
        fits = [self._checks[f"{sensor}_misfit"].of(value, MAX_FIT) for sensor, value in misfits.items()]
        return fits + [self._checks[f"{sensor}_gain"].of(value, MIN_GAIN) for sensor, value in gains.items()]

    def finish(self, state: FusedState, inputs: Mapping[str, Trajectory], /) -> Trajectory:
        """See Integrator: all nodes since the start estimated at once, and the frames between by the images, each with
        the final poses of the images. A pair that was never aligned with GNSS keeps its own poses."""
        if self._metric and state.first is None and not len(state.settled):
            return Trajectory.of([(t, pose @ self._camera_from_rig) for t, pose in inputs["visual"].items()])
        final = dict(inputs["visual"].items())
        nodes = [*state.settled, *(state.nodes if state.prior is not None else ())]
        if state.first is not None:
            older = [n for n in nodes if n.number < state.first.at[0].number]
            together = revised_nodes(tuple(n for n in nodes if n.number >= state.first.at[0].number), final)
            nodes = [*older, *self._optimised(_with_noise(together, state.noise), state.first)[0]]
        by_number, found = {node.number: node for node in nodes}, list[tuple[int, Pose]]()
        for time_ns, number, relative in state.frames:
            if (node := by_number.get(number)) is not None:
                both = time_ns in final and node.time_ns in final
                seen = final[node.time_ns].inverse() @ final[time_ns] if both else relative
                moved = self._in_rig(seen, node.log_scale)
                found.append((time_ns, WORLD_FROM_LOCAL @ node.local_from_rig @ moved))
        return Trajectory.of(found)

    def _with_other_sensors(self, state: FusedState) -> FusedState:
        """Goes on from the last pose after a change of the scheme."""
        bare = replace(self.start(), settled=state.settled, frames=state.frames, seen=state.seen, last_ns=state.last_ns)
        if state.covariance is None or not state.nodes:
            return replace(bare, number=state.number)
        settled = state.settled.extended(state.nodes[:-1])
        last = replace(state.nodes[-1].without_absolute, bias=np.zeros(6), offsets={})
        prior = self._graph.first_prior(last, state.covariance + GAUGE**2 * np.eye(6), s=0.1)
        bare = replace(bare, nodes=(last,), prior=prior, first=prior, covariance=state.covariance, settled=settled)
        return replace(bare, number=state.number)


def _with_noise(nodes: tuple[Node, ...], noise: MotionNoise | None) -> tuple[Node, ...]:
    """Returns the nodes; those in the present world of the images have the noise that is known now.

    It is the mean since that world began, and is known the better the longer that is. Nodes in an earlier world keep
    theirs.
    """
    if noise is None:
        return nodes
    begin = max((i for i, node in enumerate(nodes) if node.fresh), default=0)
    return (*nodes[:begin], *(replace(node, noise=noise) for node in nodes[begin:]))


def method_of(name: str, images: frozenset[Kind], config: type, visual: str, survey: str) -> Method:
    """Returns the Method of an estimator over the relative poses of another one; its sensors are those that are
    registered."""
    kinds = usable_kinds()
    return Method(
        name,
        images | frozenset(kinds),
        config,
        "metric",
        "Forster et al. 2017 (preintegrated IMU), Dellaert and Kaess 2017 (factor graphs)",
        "m per unit",
        {"visual": visual},
        checks_of(kinds.values()),
        STAGES,
        frozenset(kinds),
        survey,
        "own",
    )


STAGES = {
    "wait": "Keeps what the sensors measured until the next node.",
    "measure": "Makes observations of it: samples, fixes, wheels, scans.",
    "optimise": "Estimates all nodes of the window.",
    "marginalise": "Gives the covariance, and takes the oldest node out.",
}
METHOD = partial(method_of, "fused", VIDEO, FusedConfig, "monocular", "Table 2: images and other sensors")
