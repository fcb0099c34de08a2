"""Reruns of a run: with another calibration, with other noise, without some tracks, or begun later."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ispom.ensemble import Ensemble
from ispom.estimator import LeavesOut
from ispom.evaluation.budget.contradicted import FirstSeen
from ispom.evaluation.budget.noise import noise_sigma
from ispom.evaluation.doctor.hypothesis import Change
from ispom.evaluation.trajectory_error import TrajectoryError, alignment_of, error_against_truth
from ispom.methods import Config
from ispom.methods import method as registered
from ispom.simulation.scenario.calibrations import WrongPair
from ispom.simulation.scenario.spoilt import Noise
from ispom.types import Frame, Measurement, Rig, Sequence, Status, Step, Tracks, Trajectory

from ...engine.playback import Builder, Playback

Errors = Mapping[str, TrajectoryError]
"""By method; without those that have too few poses."""
LOOKED_AT = 9
"""Frames of which the noise is measured."""


@dataclass(frozen=True, eq=False)
class Bench:
    """A run that is to be run again."""

    sequence: Sequence
    """With ground truth."""
    methods: tuple[str, ...]
    config: Config
    builder: Builder
    advance: Callable[[], None]
    """Called before each frame; it may raise to end the work."""

    @property
    def truth(self) -> Trajectory:
        """world_from_rig."""
        if self.sequence.truth is None:
            raise ValueError("there is no ground truth")
        return self.sequence.truth

    def errors(self, sequence: Sequence, builder: Builder | None = None) -> Errors:
        """Runs over a sequence, and returns the errors against the ground truth of that."""
        return self._errors(self._played(Playback(sequence, self.methods, self.config, builder or self.builder)))

    def begun(self) -> tuple[Errors, int]:
        """Runs the run again as it was. Also returns the first frame at which all its methods have a pose."""
        playback = Playback(self.sequence, self.methods, self.config, self.builder)
        firsts = dict[str, int]()

        def seen(index: int, step: Step) -> None:
            if step.status is Status.TRACKING and step.world_from_frame is not None:
                firsts.setdefault(step.method, index)

        errors = self._errors(self._played(playback, seen))
        return errors, max(firsts.values(), default=0)

    def corrected(self, change: Change, sequence: Sequence) -> Errors:
        """Runs with a changed calibration and clock; the poses have the stamps of the run."""
        found = self.errors(changed(sequence, change))
        late_ns = round(change.perturbation.clock_ms * 1e6)
        return {name: _at_stamps_of(sequence, error, late_ns) for name, error in found.items()}

    def without_contradicted(self, sequence: Sequence) -> Errors:
        """Runs without the tracks that contradict the true poses."""
        return self.errors(sequence, self._held_to_truth)

    def leave_out(self) -> set[str]:
        """Returns the methods that have tracks which can be left out, or that use a method's which has."""
        made = self.builder(self.config, self.methods, self.sequence.rig)
        own = {n for n, m in made.members.items() if not m.method.asks and isinstance(m.estimator, LeavesOut)}
        return {name for name in made.members if name in own or own & set(registered(name).asks.values())}

    def _held_to_truth(self, config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
        made, truth = self.builder(config, methods, rig), self.truth
        members = {
            name: replace(member, estimator=_HeldToTruth(member.estimator, rig, truth))
            if isinstance(member.estimator, LeavesOut) and not member.method.asks
            else member
            for name, member in made.members.items()
        }
        return Ensemble(made.methods, members)

    def _played(self, playback: Playback, seen: Callable[[int, Step], None] = lambda i, s: None) -> Playback:
        while playback.more():
            self.advance()
            event = playback.step()
            for step in event.steps:
                seen(event.index, step)
        return playback

    def _errors(self, playback: Playback) -> Errors:
        sequence, found = playback.sequence, dict[str, TrajectoryError]()
        for name, path in playback.finish().trajectories.items():
            kind = alignment_of(registered(name).unit == "metric")
            assert sequence.truth is not None
            error = error_against_truth(path, sequence.truth, sequence.rig, kind) if len(path) else None
            if error is not None:
                found[name] = error
        return found


def changed(sequence: Sequence, change: Change) -> Sequence:
    """Returns the sequence with a changed calibration and clock. What the rig states of its accuracy stays: methods
    correct their cameras by as much as before. For a right camera that has turned, its images are turned back: methods
    take the pair to be rectified."""
    own = sequence.rig
    rig = replace(change, right_x_deg=0.0, right_y_deg=0.0, right_z_deg=0.0).of_rig(own)
    made = replace(sequence, rig=rig)
    back = [-change.right_x_deg, -change.right_y_deg, -change.right_z_deg]
    if any(back):
        made = WrongPair(pitch_deg=back[0], yaw_deg=back[1], roll_deg=back[2]).on(made, 0)
    made = replace(made, rig=rig.changed(pair_sigma=own.pair_sigma, video_sigma=own.video_sigma))
    late_s = change.perturbation.clock_ms * 1e-3
    return made.with_video_later(late_s) if late_s else made


def noise_of(sequence: Sequence) -> dict[str, float]:
    """Returns the noise [grey levels] of each camera's images, the median over some frames."""
    found = dict[str, list[float]]()
    for kind in sorted({kind for kind in sequence.kinds if kind in ("video", "stereo")}):
        own = [i for i, each in enumerate(sequence.kinds) if each == kind]
        for k in np.unique(np.linspace(0, len(own) - 1, LOOKED_AT).astype(int)):
            measured = sequence.load(own[int(k)])
            if isinstance(measured, Frame):
                for name, image in measured.images.items():
                    found.setdefault(name, []).append(noise_sigma(image))
    return {name: float(np.median(values)) for name, values in found.items()}


def noisier(sequence: Sequence, sigmas: Mapping[str, float], seed: int) -> Sequence:
    """Returns the sequence with this noise added to each camera's images, always the same for a seed."""
    for name, sigma in sigmas.items():
        if name in ("video", "left", "right"):
            sequence = Noise(sigma=sigma, camera=name).on(sequence, seed)
    return sequence


def _at_stamps_of(sequence: Sequence, error: TrajectoryError, late_ns: int) -> TrajectoryError:
    if not late_ns:
        return error
    video = sequence.times_ns[np.array([kind == "video" for kind in sequence.kinds])]
    times_ns = error.estimate.times_ns
    times_ns = np.where(np.isin(times_ns - late_ns, video), times_ns - late_ns, times_ns)
    _, order = np.unique(times_ns, return_index=True)
    own, true = (replace(t, times_ns=times_ns).select(order) for t in (error.estimate, error.reference))
    return replace(error, estimate=own, reference=true)


@dataclass(frozen=True, eq=False)
class _Held:
    state: Any
    first: Mapping[str, FirstSeen]


@dataclass(frozen=True, eq=False)
class _HeldToTruth:
    """An estimator whose tracks are left out from the frame on in which they contradict the true poses: for the
    question what it would give without them, and for nothing else."""

    estimator: Any
    rig: Rig
    truth: Trajectory

    def start(self) -> _Held:
        return _Held(self.estimator.start(), {})

    def step(self, held: _Held, measurement: Measurement) -> tuple[_Held, Step]:
        state, step = self.estimator.step(held.state, measurement)
        known, bad = self._contradicting(held.first, step)
        if len(bad):
            state, step = self.estimator.step(self.estimator.without_tracks(held.state, bad), measurement)
            known, _ = self._contradicting(held.first, step)
        return _Held(state, known), step

    def finish(self, held: _Held) -> Trajectory:
        return self.estimator.finish(held.state)

    def _contradicting(self, first: Mapping[str, FirstSeen], step: Step) -> tuple[Mapping[str, FirstSeen], Any]:
        pose, known, bad = self.truth.at(step.time_ns), dict(first), [np.zeros(0, np.int64)]
        for name, tracks in step.tracks.items() if pose is not None else ():
            assert isinstance(tracks, Tracks) and pose is not None
            world_from_camera = pose @ self.rig.rig_from(name)
            seen = first.get(name, FirstSeen())
            known[name], ids = seen.contradicting(self.rig.camera(name), world_from_camera, tracks)
            bad.append(ids)
        return known, np.concatenate(bad)
