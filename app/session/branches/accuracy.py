"""How accurate and how fast each branch is, as known now: measured in the worker, shown by everybody else.

The error is that of `ispom evaluate` and metrics.json: the ATE of the trajectories that `ispom run` would write if the
run ended here. The longer a run is, the longer this takes. Therefore it is measured only now and then while a run is
being computed.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import reduce

import numpy as np

from ispom.evaluation.trajectory_error import TrajectoryError, alignment_of, error_against_truth
from ispom.methods import method as registered

from ...engine.error_curve import ErrorCurve, Part, family_curves
from ...engine.external_trajectories.placed import ExternalTrajectory
from ..current_run import CurrentRun
from ..external_paths import ExternalPaths
from ..store import Store
from .branches import Branch, Measured
from .state import Branches

LEAST_S = 1.0
"""Least time between two measurements of a run that is being computed."""
SHARE = 0.05
"""Largest share of the time that measurements take."""


class Accuracy:
    """Keeps the measurements in the state up to date. For the worker's thread."""

    def __init__(self, store: Store, run_of: Callable[[int], CurrentRun | None]) -> None:
        """`run_of` gives the run of a branch."""
        self._store, self._run_of = store, run_of
        self._of: dict[int, tuple[CurrentRun, int, int]] = {}
        """By branch: the version of the run that was measured."""
        self._others_of: tuple[int, int] = (-1, 0)
        self._due_s = 0.0

    def watch(self) -> None:
        """Measures the branches that changed since they were measured last."""
        state, known = self._store.state, self._store.state[Branches]
        others = state[ExternalPaths]
        self._of = {number: of for number, of in self._of.items() if any(b.number == number for b in known.all)}
        stale = {b.number: run for b in known.all if (run := self._stale(b.number)) is not None}
        version = (state.run, state.computed)
        if not stale and (version == self._others_of or not others.all):
            return
        computing = (state.playing or state.target is not None) and not state.ended
        if computing and time.monotonic() < self._due_s:
            return
        began_s = time.monotonic()
        found = {number: measured(run) for number, run in stale.items()}
        self._of |= {number: _version(run) for number, run in stale.items()}
        measurements = tuple(replace(b, measured=found.get(b.number, b.measured)) for b in known.all)
        self._others_of, shown = version, self._run_of(known.shown)
        if stale:
            self._store.put(replace(known, all=self.with_curves(measurements)))
        if others.all:
            errors = errors_of_external(others.all, shown) if shown is not None else {}
            self._store.put(replace(others, errors=errors))
        spent_s = time.monotonic() - began_s
        self._due_s = began_s + max(LEAST_S, spent_s / SHARE)

    def with_curves(self, branches: Iterable[Branch]) -> tuple[Branch, ...]:
        """Returns the branches with their position errors, see the function `with_curves`."""
        return with_curves(branches, self._begins_ns)

    def _begins_ns(self, branch: Branch) -> int:
        """The time of the first frame that a branch computed itself."""
        run = self._run_of(branch.number)
        times_ns = run.playback.sequence.times_ns if run is not None else ()
        return int(times_ns[branch.at]) if branch.at < len(times_ns) else sys.maxsize

    def _stale(self, number: int) -> CurrentRun | None:
        """Returns the run of a branch if it has changed since it was measured; else None."""
        run = self._run_of(number)
        return run if run is not None and self._of.get(number) != _version(run) else None


def _version(run: CurrentRun) -> tuple[CurrentRun, int, int]:
    return run, len(run.history), 0 if run.recorded_frames else run.playback.position


def measured(run: CurrentRun) -> Measured:
    """Returns the error and the computing time of each method of a run, as known now."""
    truth, rig = run.opened.truth, run.opened.sequence.rig
    errors: dict[str, TrajectoryError] = {}
    if truth is not None:
        for method, trajectory in run.trajectories().items():
            kind = alignment_of(registered(method).unit == "metric")
            if (error := error_against_truth(trajectory, truth, rig, kind)) is not None:
                errors[method] = error
    seconds = {m: s for m in run.opened.methods if (s := run.series.median_seconds(m)) is not None}
    return Measured(errors, {method: ErrorCurve.of(error) for method, error in errors.items()}, seconds)


def with_curves(branches: Iterable[Branch], begins_ns: Callable[[Branch], int]) -> tuple[Branch, ...]:
    """Returns the branches with their position errors at the frames. Forks and their parents are aligned together; a
    branch that computed all frames itself has a world of its own.

    `begins_ns` is the time of the first frame that a branch computed itself.
    """
    branches = tuple(branches)
    curves: dict[int, dict[str, ErrorCurve]] = {branch.number: {} for branch in branches}
    for method in dict.fromkeys(method for branch in branches for method in branch.measured.errors):
        parts = {
            b.number: Part(b.measured.errors[method], b.parent if b.at else None, begins_ns(b) if b.at else 0)
            for b in branches
            if method in b.measured.errors
        }
        for number, curve in family_curves(parts).items():
            curves[number][method] = curve
    found = (replace(b.measured, curves=curves[b.number]) if b.measured.errors else b.measured for b in branches)
    return tuple(replace(b, measured=measured) for b, measured in zip(branches, found, strict=True))


def errors_of_external(others: Iterable[ExternalTrajectory], run: CurrentRun) -> dict[str, TrajectoryError]:
    """Returns the errors of trajectories of other programs by name, over the frames that the run has computed."""
    count = len(run.history)
    if run.opened.truth is None or not count:
        return {}
    until_ns = int(run.playback.sequence.times_ns[count - 1])
    found = {other.name: other.error(run.opened.truth, run.opened.sequence.rig, until_ns) for other in others}
    return {name: error for name, error in found.items() if error is not None}


def over_common_frames(branches: Iterable[Branch]) -> dict[tuple[int, str], TrajectoryError]:
    """Returns errors by number of the branch and method, over frames at which all of these branches have a pose of the
    method.

    Methods that only one branch has are skipped. The alignment is over the common frames.
    """
    having: dict[str, list[Branch]] = {}
    for branch in branches:
        for method in branch.measured.errors:
            having.setdefault(method, []).append(branch)
    found: dict[tuple[int, str], TrajectoryError] = {}
    for method, some in having.items():
        errors = {branch.number: branch.measured.errors[method] for branch in some}
        if len(errors) < 2:
            continue
        common = reduce(np.intersect1d, (error.estimate.times_ns for error in errors.values()))
        over = {number: error.over(common) for number, error in errors.items()}
        found |= {(number, method): error for number, error in over.items() if error is not None}
    return found
