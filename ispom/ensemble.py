"""Several methods stepped together over one sequence; what one computes for another is computed once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.blas import one_thread
from ispom.estimator import LeavesOut, Method
from ispom.methods import Config, in_order, method, require_sensors, with_dependencies
from ispom.settings import check
from ispom.solvers.influence.problem import Problem, collecting_problems
from ispom.types import Measurement, Rig, Step, Trajectory


@dataclass(frozen=True, eq=False)
class Member:
    """A method and its estimator."""

    method: Method
    estimator: Any
    """An Estimator; an Integrator of a method that depends on others."""

    def inputs(self, results: Mapping[str, Any]) -> tuple[dict[str, Any], ...]:
        """The last argument of its estimator: results of the methods that it depends on, by role. Empty without any."""
        asks = self.method.asks
        return ({role: results[name] for role, name in asks.items() if name in results},) if asks else ()


@dataclass(frozen=True, eq=False)
class Ensemble:
    """The chosen methods and their dependencies. Its state maps each method's name to its State."""

    methods: tuple[str, ...]
    """The chosen ones, in the order of the registry."""
    members: Mapping[str, Member]
    """All that run, each after its dependencies."""

    def start(self) -> dict[str, Any]:
        return {name: member.estimator.start() for name, member in self.members.items()}

    def carried(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """Its state after other methods or settings ran: estimators that ran go on from there, others start."""
        return {name: state.get(name, start) for name, start in self.start().items()}

    def step(self, state: Mapping[str, Any], measurement: Measurement) -> tuple[dict[str, Any], tuple[Step, ...]]:
        """The next state, and one Step of each chosen method that uses this measurement, in the order of `methods`."""
        after, steps = dict(state), dict[str, Step]()
        for name, member in self.members.items():
            if member.method.uses(measurement):
                after[name], step = member.estimator.step(after[name], measurement, *member.inputs(steps))
                steps[name] = replace(step, method=name)
        return after, tuple(steps[name] for name in self.methods if name in steps)

    def reported_problems(
        self, state: Mapping[str, Any], measurement: Measurement
    ) -> dict[str, tuple[Step, tuple[Problem, ...]]]:
        """By method that uses this measurement: its Step, as `step` gives it, and the problems that it reports."""
        found = dict[str, tuple[Step, tuple[Problem, ...]]]()
        for name, member in self.members.items():
            if member.method.uses(measurement):
                steps = {other: step for other, (step, _) in found.items()}
                with collecting_problems() as problems:
                    _, step = member.estimator.step(state[name], measurement, *member.inputs(steps))
                found[name] = replace(step, method=name), tuple(problems)
        return found

    def without_tracks(
        self, state: Mapping[str, Any], measurement: Measurement, name: str, ids: NDArray[np.int64]
    ) -> Step | None:
        """Returns the Step of a method from the state without these tracks (M,); None where it cannot be had so."""
        member, estimator = self.members[name], self.members[name].estimator
        if member.method.asks or not isinstance(estimator, LeavesOut):
            return None
        return member.estimator.step(estimator.without_tracks(state[name], ids), measurement)[1]

    def finish(self, state: Mapping[str, Any]) -> dict[str, Trajectory]:
        """Returns the trajectory of each chosen method."""
        trajectories: dict[str, Trajectory] = {}
        for name, member in self.members.items():
            trajectories[name] = member.estimator.finish(state[name], *member.inputs(trajectories))
        return {name: trajectories[name] for name in self.methods}


def run(ensemble: Ensemble, measurements: Iterable[Measurement]) -> Iterator[tuple[Step, ...]]:
    """Yields the Steps of each measurement. It is pulled: not taking the next one pauses the run."""
    state = ensemble.start()
    for measurement in measurements:
        state, steps = ensemble.step(state, measurement)
        yield steps


def build(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
    """Builds the methods for this rig. Raises InputError where a sensor is missing or a setting is out of its range.

    Results do not depend on the number of threads: OpenCV's never do, BLAS is held to one.
    """
    one_thread()
    chosen = in_order(methods)
    require_sensors(chosen, rig)
    for name, settings in config.given.items():
        check(settings, f"{name}.")
    return Ensemble(chosen, {n: Member(method(n), config.of(n).build(rig)) for n in with_dependencies(chosen)})
