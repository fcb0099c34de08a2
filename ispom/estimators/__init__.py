"""The methods in their variants, and running several of them over one sequence."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from ispom.errors import InputError
from ispom.estimator import Estimator
from ispom.estimators.modern.integrated.estimator import ModernIntegratedConfig
from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.estimators.paper.integrated import IntegratedConfig
from ispom.estimators.paper.monocular import MonocularConfig
from ispom.estimators.paper.stereo import StereoConfig
from ispom.settings import check
from ispom.types import Exposure, Rig, Step, Trajectory

Method = Literal["monocular", "stereo", "integrated", "integrated_paper"]
METHODS: tuple[Method, ...] = ("monocular", "stereo", "integrated")
"""What a variant has."""
COMPARED: Method = "integrated_paper"
"""The paper's integration, which can be run beside the modern one."""
ALL_METHODS: tuple[Method, ...] = (*METHODS, COMPARED)
Variant = Literal["modern", "paper"]
VARIANTS: tuple[Variant, ...] = ("modern", "paper")
DEFAULT_VARIANT: Variant = "modern"


@dataclass(frozen=True)
class ModernConfig:
    """Settings of the modern methods; `integrated` uses those of the other two as well."""

    monocular: ModernMonocularConfig = field(default_factory=ModernMonocularConfig)
    stereo: ModernStereoConfig = field(default_factory=ModernStereoConfig)
    integrated: ModernIntegratedConfig = field(default_factory=ModernIntegratedConfig)


@dataclass(frozen=True)
class Config:
    """Which variant, and the settings of every method; `integrated` uses those of the other two as well."""

    monocular: MonocularConfig = field(default_factory=MonocularConfig)
    stereo: StereoConfig = field(default_factory=StereoConfig)
    integrated: IntegratedConfig = field(default_factory=IntegratedConfig)
    modern: ModernConfig = field(default_factory=ModernConfig)
    variant: Variant = DEFAULT_VARIANT

    def of(self, method: Method) -> Any:
        """The settings that this method has in the variant."""
        if method == COMPARED:
            return self.integrated
        return getattr(self.modern if self.variant == "modern" else self, method)

    def having(self, method: Method, settings: Any) -> Config:
        """With other settings of this method of the variant."""
        if method == COMPARED:
            return replace(self, integrated=settings)
        if self.variant == "modern":
            return replace(self, modern=replace(self.modern, **{method: settings}))
        return replace(self, **{method: settings})


@dataclass(frozen=True, eq=False)
class Apart:
    """An estimator under another name, without its parts: those of the same names are other estimators'."""

    estimator: Estimator
    method: str

    def uses(self, exposure: Exposure) -> bool:
        return self.estimator.uses(exposure)

    def start(self) -> Any:
        return self.estimator.start()

    def step(self, state: Any, exposure: Exposure) -> tuple[Any, Step]:
        state, step = self.estimator.step(state, exposure)
        return state, replace(step, method=self.method, parts=())

    def finish(self, state: Any) -> Trajectory:
        return self.estimator.finish(state)


def _paper(config: Config, rig: Rig) -> Estimator:
    return config.integrated.build(rig, config.monocular, config.stereo)


def _modern(config: Config, rig: Rig) -> Estimator:
    return config.modern.integrated.build(rig, config.modern.monocular, config.modern.stereo)


_BUILD: Mapping[Variant, Mapping[Method, Callable[[Config, Rig], Estimator]]] = {
    "paper": {
        "monocular": lambda config, rig: config.monocular.build(rig),
        "stereo": lambda config, rig: config.stereo.build(rig),
        "integrated": _paper,
    },
    "modern": {
        "monocular": lambda config, rig: config.modern.monocular.build(rig),
        "stereo": lambda config, rig: config.modern.stereo.build(rig),
        "integrated": _modern,
        COMPARED: lambda config, rig: Apart(_paper(config, rig), COMPARED),
    },
}
_INSIDE: tuple[Method, ...] = ("monocular", "stereo")
"""What `integrated` computes on its way, and gives as parts."""


def possible_methods(rig: Rig, variant: Variant = DEFAULT_VARIANT) -> tuple[Method, ...]:
    """The methods of the variant that this rig has the cameras for."""
    needs = {"monocular": rig.video is not None, "stereo": rig.has_stereo}
    return tuple(m for m in ALL_METHODS if m in _BUILD[variant] and needs.get(m, all(needs.values())))


def default_methods(rig: Rig, variant: Variant = DEFAULT_VARIANT) -> tuple[Method, ...]:
    """Those that run where nobody says which: all but the one for comparison."""
    return tuple(m for m in possible_methods(rig, variant) if m != COMPARED)


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Several estimators stepped together; what `integrated` computes on its way is not computed twice."""

    methods: tuple[Method, ...]
    estimators: Mapping[str, Estimator]
    """Those that really run: `integrated` brings the other two with it."""

    def start(self) -> dict[str, Any]:
        return {name: estimator.start() for name, estimator in self.estimators.items()}

    def step(self, state: dict[str, Any], exposure: Exposure) -> tuple[dict[str, Any], tuple[Step, ...]]:
        """The next state, and one Step of each asked method that uses this exposure, in the order of ALL_METHODS."""
        state, steps = dict(state), []
        for name, estimator in self.estimators.items():
            if estimator.uses(exposure):
                state[name], step = estimator.step(state[name], exposure)
                steps += [step, *(part for part in step.parts if part.method not in self.estimators)]
        return state, tuple(s for m in ALL_METHODS for s in steps if s.method == m and m in self.methods)

    def finish(self, state: dict[str, Any]) -> dict[str, Trajectory]:
        """The trajectory of each asked method."""
        found: dict[str, Trajectory] = {}
        for name, estimator in self.estimators.items():
            found = getattr(estimator, "finish_parts", lambda _: {})(state[name]) | found
            found[name] = estimator.finish(state[name])
        return {m: found[m] for m in ALL_METHODS if m in self.methods}


def build(config: Config, methods: tuple[Method, ...], rig: Rig) -> Ensemble:
    """The asked methods for this rig; InputError where a camera is missing or a setting is out of its range."""
    check(config, "")
    for method in methods:
        if method not in _BUILD[config.variant]:
            other = "paper" if config.variant == "modern" else "modern"
            raise InputError(f"{method} is no method of --variant {config.variant}: choose --variant {other}")
    missing = [m for m in methods if m not in possible_methods(rig, config.variant)]
    if missing:
        need = "a video camera" if missing[0] == "monocular" else "a left and a right camera"
        raise InputError(f"{missing[0]} needs {need}, which this sequence lacks: choose other --methods")
    inside = _INSIDE if "integrated" in methods else ()
    asked: tuple[Method, ...] = tuple(m for m in ALL_METHODS if m in methods)
    estimators: dict[str, Estimator] = {m: _BUILD[config.variant][m](config, rig) for m in asked if m not in inside}
    return Ensemble(asked, estimators)
