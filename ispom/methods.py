"""The registry: the methods of this package, and those of installed packages (entry points `ispom.methods`)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from ispom.errors import InputError
from ispom.estimator import STEREO, VIDEO, Method
from ispom.estimators.modern.integrated import checks as integrated_checks
from ispom.estimators.modern.integrated.estimator import ModernIntegratedConfig
from ispom.estimators.modern.monocular import checks as monocular_checks
from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.estimators.modern.stereo import checks as stereo_checks
from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.estimators.paper import checks as paper_checks
from ispom.estimators.paper.integrated import IntegratedConfig
from ispom.estimators.paper.monocular import MonocularConfig
from ispom.estimators.paper.stereo import StereoConfig
from ispom.estimators.survey import found
from ispom.registry import Registry
from ispom.sensors import SENSOR_KINDS
from ispom.types import Kind, Rig

Variant = Literal["modern", "paper"]
"""A short way to choose methods: `paper` the `.paper` ones, `modern` the built-in others."""
VARIANTS: tuple[Variant, ...] = get_args(Variant)
CAMERAS: Mapping[Kind, str] = {
    "video": "a video camera",
    "stereo": "a left and a right camera",
    "cameras": "several cameras with names of their own",
}
TRANSFER, PER_UNIT = "scale transfer factor", "m per unit"
BUILT_IN = (
    Method(
        "monocular",
        VIDEO,
        ModernMonocularConfig,
        "own",
        "key frames and local bundle adjustment (PTAM, 2007)",
        TRANSFER,
        checks=monocular_checks.CHECKS,
        stages=monocular_checks.STAGES,
    ),
    Method(
        "stereo",
        STEREO,
        ModernStereoConfig,
        "metric",
        "key frames, local bundle adjustment (ORB-SLAM2 2017)",
        checks=stereo_checks.CHECKS,
        stages=stereo_checks.STAGES,
    ),
    Method(
        "integrated",
        VIDEO | STEREO,
        ModernIntegratedConfig,
        "metric",
        "continuous-time estimation on a cumulative B-spline (Spline Fusion 2013)",
        PER_UNIT,
        {"video": "monocular", "stereo": "stereo"},
        integrated_checks.CHECKS,
        integrated_checks.STAGES,
    ),
    Method(
        "monocular.paper",
        VIDEO,
        MonocularConfig,
        "own",
        "Li, Liu and Yuan 2013, section 6.1",
        TRANSFER,
        checks=paper_checks.MONOCULAR,
        stages=paper_checks.MONOCULAR_STAGES,
    ),
    Method(
        "stereo.paper",
        STEREO,
        StereoConfig,
        "metric",
        "Li, Liu and Yuan 2013, section 6.2",
        checks=paper_checks.STEREO,
        stages=paper_checks.STEREO_STAGES,
    ),
    Method(
        "integrated.paper",
        VIDEO | STEREO,
        IntegratedConfig,
        "metric",
        "Li, Liu and Yuan 2013, section 6.3",
        PER_UNIT,
        {"video": "monocular.paper", "stereo": "stereo.paper"},
        paper_checks.INTEGRATED,
        paper_checks.INTEGRATED_STAGES,
    ),
)


SURVEY = found()
"""Methods that stand for a row of the paper's survey: they run only where they are chosen by name."""
REGISTRY = Registry(
    "ispom.methods",
    Method,
    "method",
    lambda: (*BUILT_IN, *found()),
    "install the package that adds it, or name its program by --external",
)
"""Entry points of this group name a Method, or a function that gives one."""
registry, names, method, add = REGISTRY.items, REGISTRY.names, REGISTRY.get, REGISTRY.add


def in_order(method_names: Iterable[str]) -> tuple[str, ...]:
    """Returns these names, each once, in the order of the registry. Raises InputError for one that it lacks."""
    chosen = {method(name).name for name in method_names}
    return tuple(name for name in names() if name in chosen)


def with_dependencies(method_names: Iterable[str]) -> tuple[str, ...]:
    """Returns these methods and all that they depend on, each after its dependencies."""
    ordered: dict[str, None] = {}

    def add(name: str) -> None:
        for other in method(name).asks.values():
            add(other)
        ordered.setdefault(name)

    for name in method_names:
        add(name)
    return tuple(ordered)


def kinds_of(method_names: Iterable[str]) -> frozenset[Kind]:
    """Returns the kinds of measurements that these methods, and those that they depend on, use."""
    return frozenset[Kind]().union(*(method(name).sensors for name in with_dependencies(method_names)))


def possible_methods(rig: Rig) -> tuple[str, ...]:
    """Returns the methods that the rig has the sensors for."""
    return tuple(name for name, m in registry().items() if m.possible(rig))


def require_sensors(method_names: Iterable[str], rig: Rig) -> None:
    """Raises InputError where the rig lacks a sensor that one of the methods requires."""
    for name in method_names:
        phrases = {**CAMERAS, **{kind.name: kind.phrase for kind in SENSOR_KINDS.items().values()}}
        if missing := [phrases.get(kind, f"a sensor {kind}") for kind in method(name).missing(rig)]:
            need = " and ".join(missing)
            raise InputError(f"{name} needs {need}, which this sequence lacks: choose other --methods")


def default_methods(rig: Rig, variant: Variant = "modern") -> tuple[str, ...]:
    """The possible ones of a variant: what runs where nobody says which.

    Of a rig with neither a video camera nor a pair, those of the survey that step on its cameras.
    """
    built_in = {m.name for m in BUILT_IN}
    of_paper = {name for name in built_in if name.endswith(".paper")}
    of_variant = of_paper if variant == "paper" else built_in - of_paper
    possible = possible_methods(rig)
    chosen = tuple(name for name in possible if name in of_variant)
    return chosen or tuple(name for name in possible if method(name).sensors == {"cameras"})


@dataclass(frozen=True)
class Config:
    """The settings of every method; defaults for those that are not given."""

    given: Mapping[str, Any] = field(default_factory=dict)
    """By method, a value of Method.config."""

    def __post_init__(self) -> None:
        """Raises InputError for a method that is not there, and for settings that are not its own."""
        for name, settings in self.given.items():
            own = method(name).config
            if not isinstance(settings, own):
                raise InputError(
                    f"the settings of {name} are a {type(settings).__name__}: give a {own.__name__}, as from "
                    f"ispom.method({name!r}).config(NAME=VALUE)"
                )

    def of(self, name: str) -> Any:
        """The settings of a method."""
        return self.given[name] if name in self.given else method(name).config()

    def with_settings(self, name: str, settings: Any) -> Config:
        """With other settings of this method."""
        return Config({**self.given, name: settings})
