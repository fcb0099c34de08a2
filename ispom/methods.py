"""The registry: the methods of this package, and those of installed packages (entry points `ispom.methods`)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from ispom.errors import InputError
from ispom.estimator import Method
from ispom.estimators.survey import SURVEY
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
BUILT_IN = {
    "monocular": "ispom.estimators.modern.monocular.estimator:METHOD",
    "stereo": "ispom.estimators.modern.stereo.estimator:METHOD",
    "integrated": "ispom.estimators.modern.integrated.estimator:METHOD",
    "monocular.paper": "ispom.estimators.paper.monocular:METHOD",
    "stereo.paper": "ispom.estimators.paper.stereo:METHOD",
    "integrated.paper": "ispom.estimators.paper.integrated:METHOD",
}
"""Where each method is: its module is imported when the method is used."""
GROUPS: Mapping[str, tuple[str, ...]] = {
    "paper": tuple(name for name in BUILT_IN if name.endswith(".paper")),
    "survey": tuple(SURVEY),
}
"""Words that stand for several methods where somebody chooses methods."""
REGISTRY = Registry(
    "ispom.methods",
    Method,
    "method",
    {**BUILT_IN, **SURVEY},
    "install the package that adds it, or name its program by --external",
)
"""Entry points of this group name a Method, or a function that gives one."""
registry, names, method, add = REGISTRY.items, REGISTRY.names, REGISTRY.get, REGISTRY.add


def in_order(method_names: Iterable[str]) -> tuple[str, ...]:
    """Returns these names, each once, in the order of the registry. Raises InputError for one that it lacks."""
    chosen = {method(name).name for name in method_names}
    return tuple(name for name in names() if name in chosen)


def members(words: Iterable[str]) -> tuple[str, ...]:
    """Returns the methods that the words name, and all of the groups that they name, in the order of the registry."""
    return in_order(name for word in words for name in GROUPS.get(word, (word,)))


def choices(words: Iterable[str]) -> tuple[str, ...]:
    """Returns the words, each once: methods in the order of the registry, then groups, which stay words until a rig is
    known. Raises InputError for a word that is neither."""
    chosen = set(words)
    return (*in_order(chosen - GROUPS.keys()), *(group for group in GROUPS if group in chosen))


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
    of_variant = (name for name in BUILT_IN if name.endswith(".paper") == (variant == "paper"))
    chosen = tuple(name for name in of_variant if method(name).possible(rig))
    return chosen or tuple(name for name in possible_methods(rig) if method(name).sensors == {"cameras"})


def named_methods(words: Iterable[str], rig: Rig) -> tuple[str, ...]:
    """Returns the methods that the words name, and of each group those that the rig has the sensors for. Raises
    InputError where groups alone are named, and it has them for none."""
    words = tuple(words)
    found = in_order(
        name for word in words for name in GROUPS.get(word, (word,)) if word not in GROUPS or method(name).possible(rig)
    )
    if words and not found:
        groups = " and ".join(choices(words))
        raise InputError(f"this sequence has the sensors for no method of {groups}: choose other --methods")
    return found


def chosen_methods(words: Iterable[str], rig: Rig, variant: Variant = "modern") -> tuple[str, ...]:
    """Returns the methods to run: those of `named_methods`, or the default ones of the variant where there is no word.
    Raises InputError where the rig lacks a sensor that a named one requires."""
    chosen = named_methods(words, rig) or default_methods(rig, variant)
    require_sensors(chosen, rig)
    return chosen


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
