"""One run of some methods over one sequence, as events. Headless runs and the app both use it.

A run may be a fork of another run. It then begins with the frames of that run up to the fork.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.ensemble import Ensemble, build
from ispom.errors import InputError, UnreadableImage
from ispom.estimator import STEREO
from ispom.geometry import Pose, Similarity
from ispom.io.files import Places, bounded, expanded
from ispom.methods import Config, kinds_of
from ispom.methods import method as registered
from ispom.sequences.readable import MAX_UNREADABLE_SHARE
from ispom.settings import files_named
from ispom.solvers.influence.problem import Problem
from ispom.stopwatch import cpu_clock
from ispom.types import Rig, Sequence, Step, Trajectory

from .events import Finished, Opened, Stepped, blank
from .external_trajectories.placed import ExternalTrajectory
from .model.placing import Placing

SPACING_NS = 1_000_000_000
"""Least interval between the poses of a reference that has one for each video frame: with shorter ones the motion is
too short to determine a unit."""
Builder = Callable[[Config, tuple[str, ...], Rig], Ensemble]
"""Makes the estimators of some methods. Raises InputError as `ispom.ensemble.build`."""


def builder_within(places: Places, config: Config, builder: Builder) -> Builder:
    """Returns a builder that reads only those files named in settings that this config names, or that are in `places`
    (with links resolved). None: all files."""
    if places is None:
        return builder
    named = [file for given in config.given.values() for file in files_named(type(given), vars(given)).values()]
    allowed = (*places, *map(expanded, named))

    def within(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
        with bounded(allowed):
            return builder(config, methods, rig)

    return within


@dataclass(frozen=True, eq=False)
class Stage:
    """The methods and settings before a fork."""

    until: int
    """The first frame that ran with other methods or settings."""
    methods: tuple[str, ...]
    config: Config


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The state of a run between two frames, as a value. The run can be continued from it any number of times."""

    position: int
    """The next frame."""
    skipped: tuple[str, ...]
    states: Mapping[str, Any]
    """State of each method's estimator."""
    placements: Mapping[str, Similarity]
    placing: Mapping[str, Placing]


@dataclass
class Playback:
    """Steps through a sequence. Not a value: it holds the current state of a run, and nothing that grows."""

    sequence: Sequence
    methods: tuple[str, ...]
    config: Config = field(default_factory=Config)
    builder: Builder = build
    earlier: tuple[Stage, ...] = ()
    """The stages from the start up to the fork with which this run began, oldest first."""
    external_trajectories: tuple[ExternalTrajectory, ...] = ()
    """Trajectories of other programs over the same sequence."""

    def __post_init__(self) -> None:
        begun = (stage for stage in self.earlier if stage.until > 0)  # a fork at the first frame shares none
        self._stages = (*begun, Stage(sys.maxsize, self.methods, self.config))
        self.sequence = self._used()
        # The last one first: a mistake in the options is found before anything runs.
        self._final: Ensemble = self.builder(self.config, self.methods, self.sequence.rig)
        self.ensemble: Ensemble = self._build(self._stages[0])
        self.truth = truth_from_start(self.sequence)
        self.position = 0
        self.cpu_s = 0.0
        """CPU time of the estimators in the last step [s], of all threads of this process."""
        self.skipped: list[str] = []
        """What was wrong with each skipped frame."""
        self._state = self.ensemble.start()
        start = Pose() if self.sequence.rig.has_stereo else self.sequence.rig.rig_from_video
        known = [registered(name) for name in self.methods]
        metric = [m for m in known if m.unit == "metric"]
        self._reference = min(metric, key=lambda m: (m.world != "start", m.sensors != STEREO), default=None)
        """The metric method whose world is the shared one: if possible one whose world is at the start, and that uses
        pairs."""
        spacing_ns = 0 if self._reference is None or self._reference.sensors == STEREO else SPACING_NS
        free = [m for m in known if m.unit == "own" or (m.world == "own" and m is not self._reference)]
        self._placements: dict[str, Similarity] = {m.name: Similarity(1.0, start) for m in free}
        self._placing: dict[str, Placing] = {
            m.name: Placing(self.sequence.rig, None if m.unit == "own" else 1.0, spacing_ns) for m in free
        }
        """By method: the placing of those with a unit or a world of their own that have no placement yet."""

    def _used(self) -> Sequence:
        """Returns the sequence without the additional sensors that the first stage does not use, because a fork has the
        frames of its parent. InputError where a later stage uses one of these sensors."""
        found = self.sequence.used_by(kinds_of(self._stages[0].methods))
        left_out = self.sequence.beside.difference(found.kinds)
        for name in (name for stage in self._stages for name in stage.methods):
            if missing := sorted(left_out & kinds_of((name,))):
                raise InputError(f"{name} uses the {missing[0]}, which the run before it left out: begin with {name}")
        return found

    @property
    def snapshot(self) -> Snapshot:
        placing = {name: placing.copy() for name, placing in self._placing.items()}
        return Snapshot(self.position, tuple(self.skipped), self._state, dict(self._placements), placing)

    def forked(self, at: int, methods: tuple[str, ...], config: Config, snapshot: Snapshot | None = None) -> Playback:
        """Returns another run, which is the same as this one up to frame `at`, and has other methods or settings after.

        It begins at `snapshot`, a snapshot of this run at or before `at`, or else at the start. InputError as
        `builder`.
        """
        earlier = [stage for stage in self._stages[:-1] if stage.until < at]
        here = next(stage for stage in self._stages if stage.until >= at)
        stages = (*earlier, Stage(at, here.methods, here.config)) if at else ()
        found = Playback(self.sequence, methods, config, self.builder, stages, self.external_trajectories)
        if snapshot is not None:
            found._resume(snapshot)
        return found

    def _resume(self, snapshot: Snapshot) -> None:
        stage = next(stage for stage in self._stages if stage.until >= snapshot.position)
        self.ensemble = self._build(stage)
        self.position, self.skipped, self._state = snapshot.position, list(snapshot.skipped), dict(snapshot.states)
        self._placements |= snapshot.placements
        known = {name: placing.copy() for name, placing in snapshot.placing.items()}
        self._placing = {
            name: known.get(name, placing)
            for name, placing in self._placing.items()
            if name in known or name not in snapshot.placements
        }

    def _build(self, stage: Stage) -> Ensemble:
        same = stage.methods == self.methods and stage.config == self.config
        return self._final if same else self.builder(stage.config, stage.methods, self.sequence.rig)

    def _enter_stage(self) -> None:
        """Changes to the methods and settings of the next stage, if one begins at this frame."""
        ended = [i for i, stage in enumerate(self._stages) if stage.until == self.position]
        if ended:
            self.ensemble = self._build(self._stages[ended[-1] + 1])
            self._state = self.ensemble.carried(self._state)

    @property
    def opened(self) -> Opened:
        return Opened(
            self.sequence, self.methods, self.config, self.truth, external_trajectories=self.external_trajectories
        )

    @property
    def done(self) -> bool:
        """Returns whether no frame is left."""
        return self.position >= len(self.sequence) and self.sequence.grow is None

    def more(self, patience_s: float | None = None) -> bool:
        """Returns whether there is a next frame. For a live source it waits for `patience_s` (None: until the source
        ends).

        InputError, once, where the live source fails.
        """
        while self.position >= len(self.sequence) and self.sequence.grow is not None:
            before = self.sequence
            self.sequence = self.sequence.grow(self.position, patience_s)
            if len(self.sequence) == len(before) and self.sequence.grow is not None:
                return False
        return self.position < len(self.sequence)

    def end(self) -> None:
        """Ends the run here, as if the sequence had no more frames."""
        self.sequence = replace(self.sequence.truncated(self.position), grow=None)

    def unit_m(self, method: str) -> float | None:
        """Returns the unit of a method's own world [m]; None where it is unknown."""
        if method in self._placing and registered(method).unit == "own":
            return None
        return self._placements[method].scale if method in self._placements else 1.0

    def step(self) -> Stepped:
        """Runs the next frame. The position does not advance where loading it raises InputError.

        One in a hundred may be unreadable: the estimators go on from the one before to the one after.
        """
        self._enter_stage()
        index = self.position
        try:
            exposure = self.sequence[index]
        except UnreadableImage as fault:
            return self._skip(index, str(fault))
        begun_s = cpu_clock()
        self._state, steps = self.ensemble.step(self._state, exposure)
        self.cpu_s = cpu_clock() - begun_s
        self.position = index + 1
        self._place(steps)
        steps = tuple(step for step in steps if step.method in self.methods)
        return Stepped(index, exposure, steps, dict(self._placements), self._errors(steps))

    def reported_problems(self) -> dict[str, tuple[Step, tuple[Problem, ...]]]:
        """Returns for each method its Step at the next frame, and the problems that it solves in it. The run does not
        step.

        Raises InputError where the frame cannot be read.
        """
        self._enter_stage()
        return self.ensemble.reported_problems(self._state, self.sequence[self.position])

    def without_tracks(self, method: str, ids: NDArray[np.int64]) -> Step | None:
        """Returns the Step of a method at the next frame as it is if these tracks (M,) are removed before; None where
        that is not possible. The run does not step."""
        self._enter_stage()
        return self.ensemble.without_tracks(self._state, self.sequence[self.position], method, ids)

    def _skip(self, index: int, fault: str) -> Stepped:
        if len(self.skipped) + 1 > MAX_UNREADABLE_SHARE * len(self.sequence):
            more = f" (skipped before it: {len(self.skipped)})" if self.skipped else ""
            raise InputError(fault + more)
        self.skipped.append(fault)
        self.position = index + 1
        nothing = blank(self.sequence, index)
        return Stepped(index, nothing, (), dict(self._placements), {}, fault)

    def finish(self) -> Finished:
        ensemble = self._final
        return Finished(ensemble.finish(ensemble.carried(self._state)), dict(self._placements))

    def placed(self, step: Step) -> Pose | None:
        """shared_world_from_rig of a step, or None where it has no pose."""
        if step.world_from_frame is None:
            return None
        placement = self._placements.get(step.method, Similarity())
        return placement.apply_pose(step.world_from_frame) @ self.sequence.rig.rig_from(step.frame).inverse()

    def _errors(self, steps: tuple[Step, ...]) -> dict[str, float]:
        """The live errors, by method: see `Stepped.errors_m`."""
        errors = {}
        for step in steps if self._reference is None or self._reference.world == "start" else ():
            pose = self.placed(step)
            truth = self.truth.at(step.time_ns) if self.truth is not None else None
            metric = step.method not in self._placing
            if pose is not None and not step.provisional and truth is not None and metric:
                errors[step.method] = float(np.linalg.norm(pose.translation - truth.translation))
        return errors

    def _place(self, steps: tuple[Step, ...]) -> None:
        """Places each method once: the first segment of the reference fixes the position and the unit of its drawn
        trajectory."""
        if (reference := self._reference) is None:
            return
        for name, placing in tuple(self._placing.items()):
            for step in steps:
                if step.method == reference.name and step.world_from_frame is not None and not step.provisional:
                    rig_from_frame = self.sequence.rig.rig_from(step.frame)
                    placing.add_metric(step.time_ns, step.world_from_frame @ rig_from_frame.inverse())
                if step.method == name:
                    if step.world_from_frame is not None and not step.provisional:
                        placing.add_video(Trajectory.of([(step.time_ns, step.world_from_frame)], step.frame))
                    placing.add_video(step.revised)
            placement = placing.found()
            if placement is not None:
                self._placements[name] = placement
                del self._placing[name]


def truth_from_start(sequence: Sequence) -> Trajectory | None:
    """Returns the truth in the world of the rig at the first stereo frame (without stereo: the first frame)."""
    if sequence.truth is None or not len(sequence.truth):
        return None
    first_kind = "stereo" if sequence.rig.has_stereo else "video"
    first = next(
        (int(t) for t, kind in zip(sequence.times_ns, sequence.kinds, strict=True) if kind == first_kind), None
    )
    start = sequence.truth.at(first) if first is not None else None
    return sequence.truth.moved(left=(start or sequence.truth.pose(0)).inverse())
