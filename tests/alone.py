"""One method with all that it asks, stepped as if it were an estimator by itself."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from ispom import methods
from ispom.ensemble import Ensemble, build
from ispom.methods import Config, method
from ispom.types import Measurement, Rig, Step, Trajectory
from tests.line_scene import line_sequence
from tests.tag_scene import tag_sequence

METHODS = ("monocular", "stereo", "integrated")
PAPER = tuple(f"{name}.paper" for name in METHODS)
SURVEY = tuple(name for name in methods.SURVEY if not method(name).asks)
ALL = (*METHODS, *PAPER, *SURVEY)
OWN_SEQUENCES = {"tags": tag_sequence, "lines.monocular": line_sequence}
"""What methods that need something special in the scene are tested on."""
OF_CAMERAS = tuple(name for name in SURVEY if method(name).sensors == {"cameras"})
"""Those that step on frames of several cameras with names of their own; a video camera and a pair have none."""


@dataclass(frozen=True, eq=False)
class Alone:
    name: str
    ensemble: Ensemble

    def uses(self, exposure: Measurement) -> bool:
        return method(self.name).uses(exposure)

    def start(self) -> dict[str, Any]:
        return self.ensemble.start()

    def step(self, state: dict[str, Any], exposure: Measurement) -> tuple[dict[str, Any], Step]:
        state, (step,) = self.ensemble.step(state, exposure)
        return state, step

    def finish(self, state: dict[str, Any]) -> Trajectory:
        return self.ensemble.finish(state)[self.name]

    def finish_asked(self, state: dict[str, Any], role: str) -> Trajectory:
        """The trajectory of a method that it asks."""
        name = method(self.name).asks[role]
        return self.ensemble.members[name].estimator.finish(state[name])


def alone(name: str, rig: Rig, settings: Any = None) -> Alone:
    """The method, with its default settings or others."""
    config = Config() if settings is None else Config({name: settings})
    return Alone(name, build(config, (name,), rig))


def run(estimator: Any, exposures: Iterable[Measurement]) -> Iterator[Step]:
    """The Steps of a method alone, or of an estimator that asks no other, over exposures that it uses."""
    state = estimator.start()
    for exposure in exposures:
        if not isinstance(estimator, Alone) or estimator.uses(exposure):
            state, step = estimator.step(state, exposure)
            yield step


def stepped_through(estimator: Any, exposures: Iterable[Measurement], state: Any = None) -> tuple[Any, list[Step]]:
    """The state after exposures, all of which the estimator uses, and their Steps; from its start, or a state on."""
    state, steps = estimator.start() if state is None else state, list[Step]()
    for exposure in exposures:
        state, step = estimator.step(state, exposure)
        steps.append(step)
    return state, steps
