"""Images, IMU and GNSS fused by the points of the images themselves: tight coupling (schemes 1, 2, 4 and 6 of Table 2).

1. Nodes: as in `fused`, every `node_s` seconds and at each fix. Each has the tracked points of its image.
2. Start: from a rig that stands, gravity and the gyroscope's bias; else as `fused`, by the poses of `monocular`.
3. Graph: the points of tracks by inverse depth (Civera et al. 2008), eliminated as in smart factors (Carlone et al.
   2014); preintegrated IMU with biases (Forster et al. 2017), positions of the antenna. No relative pose of a visual
   method enters, so its scale and drift do not either.
4. What leaves the window stays as a joint prior on the nodes that its tracks see (`fused_tight_graph`).

The tracks are those of `monocular`, also while it has no map, and so is the correction of the lens: the IMU and a few
points are enough here. Between nodes the IMU gives the pose, without one the images do. At the end all nodes and tracks
are estimated at once.

Limits: one noise for all points; clocks and places of sensors in the rig are taken as exact; a start while moving
needs a map of `monocular`. A vehicle that hardly accelerates shows its IMU no scale. Figures are in
docs/methods/notes/fused_tight.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np

from ispom.estimator import VIDEO, Method
from ispom.estimators.survey.fused import STAGES, WAITING_NODES, WORLD_FROM_LOCAL, Fused, FusedConfig, usable_kinds
from ispom.estimators.survey.fused_checks import LOCATED, START_SIGMA, STARTED, checks_of
from ispom.estimators.survey.fused_nodes import FusedState
from ispom.estimators.survey.fused_start import Start, fix_checks, resting, started
from ispom.estimators.survey.fused_tight_graph import STILL_M_S, TightGraph
from ispom.estimators.survey.fused_values import imu_of, revised_nodes
from ispom.geometry import Pose
from ispom.persistent_list import PersistentList
from ispom.sensors.fusion import FLOOR_M, FLOOR_RAD, NO_POINTS, Node, Points
from ispom.sensors.imu import inertial_between, inertial_of, predicted
from ispom.settings import Range, checked
from ispom.stopwatch import Stopwatch
from ispom.types import (
    Decision,
    Kind,
    Landmarks,
    LensCorrection,
    Measurement,
    Rig,
    Status,
    Step,
    TrackStatus,
    Trajectory,
)

WORST_START = 0.15
"""Standard deviation of the position, as a share of the way, with which a start in motion is accepted."""


@dataclass(frozen=True)
class FusedTightConfig(FusedConfig):
    """Settings of `fused.tight`."""

    scheme: Literal["auto", "1", "2", "4", "6"] = "auto"
    """Which sensors take part, by the scheme of Table 2: 1, 2 GNSS and IMU; 4 GNSS; 6 IMU; auto: those that the
    recording has."""
    node_s: Annotated[float, Range(0.05, 2)] = 0.2
    """Time from one node of the graph to the next [s]."""
    noise_px: Annotated[float, Range(0.05, 10)] = 0.5
    """Standard deviation of a tracked point [px]."""

    def build(self, rig: Rig) -> Tight:
        """Returns the estimator. Raises InputError without a sensor of the scheme, or without gtsam."""
        return Tight(rig, checked(self))


@dataclass(frozen=True, eq=False)
class TightState(FusedState):
    """The state of `fused` with the points."""

    points: Points = NO_POINTS
    """Points of the present image."""
    seen_points: PersistentList[tuple[int, Points]] = PersistentList()
    """All points by number of their node; the window has those that were not marginalised."""
    lens: LensCorrection | None = None
    """Correction of the calibration by `monocular`."""
    speed_sigma: float = 0.0
    """Standard deviation of the velocity at the last node [m/s]."""


class Tight(Fused):
    """An Integrator of `monocular`."""

    tightly = True
    least: frozenset[Kind] = frozenset({"imu", "gnss"})
    least_phrase = "an IMU or a GNSS antenna"

    def __init__(self, rig: Rig, config: FusedTightConfig) -> None:
        super().__init__(rig, config, "fused.tight", "video")
        self._camera = rig.camera("video")
        self._tight = TightGraph(rig, self._sensors, self._camera_from_rig, config.noise_px)

    def start(self) -> TightState:
        """See Integrator."""
        return TightState(self._sensors)

    def step(self, state: Any, measurement: Measurement, inputs: Mapping[str, Step], /) -> tuple[Any, Step]:
        """See Integrator."""
        if "visual" in inputs and (tracks := inputs["visual"].tracks.get("video")) is not None:
            alive = tracks.status < TrackStatus.LOST
            xy = self._camera.normalise(tracks.uv[alive]).astype(np.float32)
            lens = inputs["visual"].calibration.lens
            state = replace(state, points=Points(tracks.ids[alive], xy), lens=state.lens if lens is None else lens)
        return super().step(state, measurement, inputs)

    def _due(self, state: Any, time_ns: int, sighted: bool) -> bool:
        return super()._due(state, time_ns, sighted or "imu" in self._sensors)

    def _between(self, state: Any, time_ns: int, sighted: bool) -> tuple[Any, Step]:
        """A frame between two nodes: the IMU, or else the images, lead there from the last node."""
        if not state.nodes:
            return state, Step(time_ns, Status.INITIALISING, decisions=(LOCATED.of(0, 1),))
        last, moved = state.nodes[-1], None
        inertial = inertial_between(state.memory.get("imu", ()), last.time_ns, time_ns)
        start = dict(state.seen).get(last.time_ns)
        if inertial is not None:
            moved = last.local_from_rig.inverse() @ predicted(last, inertial, self._tight.rig_from_body)[0]
        elif sighted and start is not None:
            moved = self._in_rig(start.inverse() @ dict(state.seen)[time_ns], last.log_scale)
        located = state.prior is not None and moved is not None and state.covariance is not None
        decisions = (LOCATED.of(int(moved is not None), 1),)
        if not located or moved is None:
            waits = state.prior is None
            return state, Step(time_ns, Status.INITIALISING if waits else Status.LOST, decisions=decisions)
        state = replace(state, frames=state.frames.appended((time_ns, last.number, moved)))
        along, seconds = moved.inverse().adjoint, (time_ns - last.time_ns) * 1e-9
        length = float(np.linalg.norm(moved.translation))
        place = FLOOR_M + (state.speed_sigma * seconds if inertial is not None else 0.01 * length)
        noise = np.diag([place] * 3 + [0.1 * FLOOR_RAD] * 3) ** 2
        covariance = along @ state.covariance @ along.T + noise
        pose = WORLD_FROM_LOCAL @ last.local_from_rig @ moved
        return state, Step(time_ns, Status.TRACKING, "rig", pose, covariance, decisions=decisions)

    def _next(self, state: Any, time_ns: int) -> tuple[Any, Node]:
        """Returns the next node with its points; after the start, at the position that the IMU predicts."""
        state, node = self._collector.next_node(state, time_ns)
        node, inertial = replace(node, points=state.points), inertial_of(node)
        if state.prior is not None and inertial is not None:
            pose, velocity = predicted(state.nodes[-1], inertial, self._tight.rig_from_body)
            node = replace(node, local_from_rig=pose, velocity=velocity)
        return replace(state, seen_points=state.seen_points.appended((node.number, node.points))), node

    def _waiting_for_start(self, state: Any, time_ns: int, watch: Stopwatch) -> tuple[Any, Step]:
        if state.fresh:
            state = replace(state, nodes=())
        state, node = self._next(state, time_ns)
        nodes = revised_nodes((*state.nodes, node)[-WAITING_NODES:], dict(state.seen))
        state = replace(state, nodes=nodes)
        watch.lap("measure")
        begin = self._begin(nodes)
        decisions = (LOCATED.of(1, 1), STARTED.of(len(nodes), WAITING_NODES, passed=begin is not None))
        if begin is None:
            missing = fix_checks(nodes, self._config.start_m) if "gnss" in self._sensors else ()
            decisions += tuple(check for check in missing if not check.passed)
            return state, Step(time_ns, Status.INITIALISING, decisions=decisions)
        start, still = begin
        covariance = self._tight.first_covariance(start.nodes[0].local_from_rig, np.radians(self._config.tilt_deg))
        prior = self._tight.first_prior(start.nodes[0], covariance, **({"v": STILL_M_S} if still else {}))
        nodes, misfits = self._tight.optimised(start.nodes, prior, state.lens)
        way = sum(
            float(np.linalg.norm(b.local_from_rig.translation - a.local_from_rig.translation))
            for a, b in pairwise(nodes)
        )
        covariance = self._tight.uncertainty(nodes, prior, state.lens).covariance
        watch.lap("optimise")
        sigma_m = float(np.sqrt(np.trace(covariance[:3, :3])))
        if not still and sigma_m > WORST_START * way:
            certain = START_SIGMA.of(sigma_m / way if way else np.inf, WORST_START, passed=False)
            count = STARTED.of(len(nodes), WAITING_NODES, passed=False)
            return state, Step(time_ns, Status.INITIALISING, decisions=(LOCATED.of(1, 1), count, certain))
        frames = state.frames.extended([(n.time_ns, n.number, Pose()) for n in nodes])
        state = replace(state, nodes=nodes, prior=prior, first=prior, frames=frames)
        return self._reported_tightly(state, decisions, misfits, watch)

    def _begin(self, nodes: tuple[Node, ...]) -> tuple[Start, bool] | None:
        """Returns first estimates of nodes at the end of these, and whether the rig stands there."""
        frames = self._camera_from_rig, self._tight.rig_from_body
        if "gnss" not in self._sensors:
            since = next((n for n in nodes[::-1] if nodes[-1].time_ns - n.time_ns >= 1e9), None)
            if since is not None:
                recent = tuple(n for n in nodes if n.time_ns >= since.time_ns)
                still = resting(recent, *frames, float(np.sqrt(self._camera.fx * self._camera.fy)))
                if still is not None:
                    return still, True
        unseen = max((i for i, n in enumerate(nodes) if n.camera is None), default=-1)
        seen = nodes[unseen + 1 :]
        start = started(seen, *frames, "gnss" in self._sensors, None, self._config.start_m) if len(seen) > 1 else None
        return None if start is None else (start, False)

    def _with_node(self, state: Any, time_ns: int, watch: Stopwatch) -> tuple[Any, Step]:
        state, node = self._next(state, time_ns)
        watch.lap("measure")
        nodes = revised_nodes((*state.nodes, node), dict(state.seen))
        nodes, misfits = self._tight.optimised(nodes, state.prior, state.lens)
        watch.lap("optimise")
        frames = state.frames.appended((time_ns, node.number, Pose()))
        state = replace(state, nodes=nodes, frames=frames)
        return self._reported_tightly(state, (LOCATED.of(node.motion_sources, 1),), misfits, watch)

    def _reported_tightly(
        self, state: Any, decisions: tuple[Decision, ...], misfits: Mapping[str, float], watch: Stopwatch
    ) -> tuple[Any, Step]:
        """Returns the Step of the last node, and the window without the nodes that are too many."""
        nodes = (*state.nodes[:-1], self._scaled(state.nodes))
        last, prior, settled = nodes[-1], state.prior, state.settled
        state = self._with_clock(state)
        uncertainty = self._tight.uncertainty(nodes, prior, state.lens)
        revised = Trajectory.of([(n.time_ns, WORLD_FROM_LOCAL @ n.local_from_rig) for n in nodes[:-1]])
        while len(nodes) > self._config.window:
            settled = settled.appended(replace(nodes[0], points=NO_POINTS))
            prior, nodes = self._tight.reduced(nodes, prior, state.lens)
        watch.lap("marginalise")
        covariance, speed_sigma = uncertainty.covariance, uncertainty.by_letter.get("v", 0.0)
        state = replace(
            state, nodes=nodes, prior=prior, settled=settled, covariance=covariance, speed_sigma=speed_sigma
        )
        return state, Step(
            last.time_ns,
            Status.TRACKING,
            "rig",
            WORLD_FROM_LOCAL @ last.local_from_rig,
            covariance,
            key_frame=True,
            revised=revised,
            calibration=imu_of(last, covariance, uncertainty.unknowns, state.clock),
            decisions=(*decisions, *self._sensor_decisions(misfits, uncertainty.gains)),
        )

    def _scaled(self, nodes: tuple[Node, ...]) -> Node:
        """Returns the last node with the ratio of the ways of the graph to those of the images."""
        way, seen, last = 0.0, 0.0, nodes[-1]
        for before, now in pairwise(nodes):
            if now.visual is not None and not now.fresh:
                moved = before.local_from_rig.inverse() @ now.local_from_rig
                moved = self._camera_from_rig @ moved @ self._camera_from_rig.inverse()
                way, seen = (
                    way + float(np.linalg.norm(moved.translation)),
                    seen + float(np.linalg.norm(now.visual.translation)),
                )
        return replace(last, log_scale=float(np.log(way / seen))) if way > 0 and seen > 0 else last

    def _landmarks(self, state: Any, visual: Step, world_from_rig: Pose | None) -> Landmarks:
        return super()._landmarks(state, visual, world_from_rig) if len(visual.landmarks) else Landmarks.empty()

    def finish(self, state: Any, inputs: Mapping[str, Trajectory], /) -> Trajectory:
        """See Integrator: all nodes and tracks since the start estimated at once, and the frames between as they were
        relative to their node."""
        if state.first is None:
            return Trajectory.empty()
        points = dict(state.seen_points)
        nodes = [*state.settled, *state.nodes]
        begin = state.first.at[0].number
        older = [n for n in nodes if n.number < begin]
        together = tuple(replace(n, points=points[n.number]) for n in nodes if n.number >= begin)
        nodes = [*older, *self._tight.optimised(together, state.first, state.lens)[0]]
        return Trajectory.of(_filled({n.number: n for n in nodes}, list(state.frames)))

    def _with_other_sensors(self, state: Any) -> Any:
        """Goes on from the last pose after a change of the scheme."""
        bare = replace(self.start(), settled=state.settled, frames=state.frames, seen=state.seen, last_ns=state.last_ns)
        bare = replace(bare, number=state.number, seen_points=state.seen_points, points=state.points, lens=state.lens)
        if state.covariance is None or not state.nodes:
            return bare
        last = replace(state.nodes[-1].without_absolute, bias=np.zeros(6), offsets={})
        prior = self._tight.first_prior(last, state.covariance)
        settled = state.settled.extended(state.nodes[:-1])
        covariance = state.covariance
        return replace(
            bare,
            nodes=(last,),
            prior=prior,
            first=prior,
            covariance=covariance,
            settled=settled,
        )


def _filled(nodes: dict[int, Node], frames: list[tuple[int, int, Pose]]) -> list[tuple[int, Pose]]:
    """Returns the poses of all frames: (time_ns, number of the node before, motion from there as known live)."""
    return [(t, WORLD_FROM_LOCAL @ nodes[n].local_from_rig @ moved) for t, n, moved in frames if n in nodes]


def method_of() -> Method:
    """Returns the Method; its sensors are those registered ones that are coupled tightly."""
    kinds = usable_kinds(tightly=True)
    return Method(
        "fused.tight",
        VIDEO | frozenset(kinds),
        FusedTightConfig,
        "metric",
        "Forster et al. 2017 (preintegrated IMU), Carlone et al. 2014 (smart factors)",
        "m per unit",
        {"visual": "monocular"},
        checks_of(kinds.values()),
        STAGES,
        frozenset(kinds),
        "Table 2: images, IMU and GNSS, tightly coupled",
        "own",
    )


METHOD = method_of
