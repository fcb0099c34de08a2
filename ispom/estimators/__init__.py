"""The methods, and running several of them over one sequence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from ispom.errors import InputError
from ispom.estimator import Estimator
from ispom.estimators.integrated import IntegratedConfig
from ispom.estimators.monocular import MonocularConfig
from ispom.estimators.stereo import StereoConfig
from ispom.settings import check
from ispom.types import Exposure, Rig, Step, Trajectory

Method = Literal["monocular", "stereo", "integrated"]
METHODS: tuple[Method, ...] = ("monocular", "stereo", "integrated")
Variant = Literal["paper"]


@dataclass(frozen=True)
class Config:
    """Settings of every method; `integrated` uses those of the other two as well."""

    monocular: MonocularConfig = field(default_factory=MonocularConfig)
    stereo: StereoConfig = field(default_factory=StereoConfig)
    integrated: IntegratedConfig = field(default_factory=IntegratedConfig)


def possible_methods(rig: Rig) -> tuple[Method, ...]:
    """The methods that this rig has the cameras for."""
    has = {"monocular": rig.video is not None, "stereo": rig.has_stereo}
    return tuple(m for m in METHODS if (all(has.values()) if m == "integrated" else has[m]))


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Several estimators stepped together; what `integrated` computes on its way is not computed twice."""

    methods: tuple[Method, ...]
    estimators: Mapping[str, Estimator]
    """Those that really run: `integrated` brings the other two with it."""

    def start(self) -> dict[str, Any]:
        return {name: estimator.start() for name, estimator in self.estimators.items()}

    def step(self, state: dict[str, Any], exposure: Exposure) -> tuple[dict[str, Any], tuple[Step, ...]]:
        """The next state, and one Step of each asked method that uses this exposure, in the order of METHODS."""
        state, steps = dict(state), []
        for name, estimator in self.estimators.items():
            if estimator.uses(exposure):
                state[name], step = estimator.step(state[name], exposure)
                steps += [*step.parts, step]
        return state, tuple(s for m in METHODS for s in steps if s.method == m and m in self.methods)

    def finish(self, state: dict[str, Any]) -> dict[str, Trajectory]:
        """The trajectory of each asked method."""
        found = {}
        for name, estimator in self.estimators.items():
            found |= getattr(estimator, "finish_parts", lambda _: {})(state[name])
            found[name] = estimator.finish(state[name])
        return {m: found[m] for m in METHODS if m in self.methods}


def build(config: Config, methods: tuple[Method, ...], rig: Rig) -> Ensemble:
    """The asked methods for this rig; InputError where a camera is missing or a setting is out of its range."""
    check(config, "")
    missing = [m for m in methods if m not in possible_methods(rig)]
    if missing:
        need = "a video camera" if missing[0] == "monocular" else "a left and a right camera"
        raise InputError(f"{missing[0]} needs {need}, which this sequence lacks: choose other --methods")
    estimators: dict[str, Estimator]
    if "integrated" in methods:
        estimators = {"integrated": config.integrated.build(rig, config.monocular, config.stereo)}
    else:
        estimators = {m: getattr(config, m).build(rig) for m in METHODS if m in methods}
    return Ensemble(tuple(m for m in METHODS if m in methods), estimators)
