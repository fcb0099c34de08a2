"""What a config dataclass says about its fields: ranges, read by checks, command line and GUI."""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from itertools import pairwise
from numbers import Integral, Real
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from ispom.errors import InputError

C = TypeVar("C")


@dataclass(frozen=True)
class Range:
    """Allowed values low..high, both included: `Annotated[float, Range(0, 1)]`."""

    low: float
    high: float


@dataclass(frozen=True)
class Choices:
    """Allowed names, of which packages may add some: `Annotated[str, Choices(front_ends)]`."""

    names: Callable[[], tuple[str, ...]]


@dataclass(frozen=True)
class NamesFile:
    """A text that names a file or folder, empty for none: `Annotated[str, NamesFile()]`. A run that was not written on
    this machine may name only what lies in its own folder."""


@dataclass(frozen=True)
class WorthTrying:
    """Other values that the doctor tries where tracking is lost: `Annotated[int, Range(50, 3000), WorthTrying((2,))]`.

    Not for a setting that says when a frame counts as located: a lower threshold is always passed more often.
    """

    times: tuple[float, ...] = ()
    """Factors of the present value."""
    values: tuple[Any, ...] = ()


@dataclass(frozen=True)
class Setting:
    """One field of a config dataclass, as a form or a flag needs it."""

    name: str
    type: Any
    """bool, int, float, str or a Literal[...]."""
    range: Range | None
    config: type
    """The dataclass that has it."""
    worth_trying: WorthTrying = WorthTrying()
    names_file: bool = False
    """Whether its text names a file or folder."""

    @property
    def help(self) -> str:
        """The docstring below the field; empty without one."""
        return _field_docs(self.config).get(self.name, "")


def settings(config: type) -> tuple[Setting, ...]:
    """The fields of a config dataclass, in order, with their ranges. Choices are those of now: a notebook may have
    registered another one."""
    return tuple(
        s if choices is None else replace(s, type=Literal[choices.names()]) for s, choices in _declared(config)
    )


@cache
def _declared(config: type) -> tuple[tuple[Setting, Choices | None], ...]:
    """Returns the fields of a config dataclass, in order, and the Choices of each."""
    hints, result = get_type_hints(config, include_extras=True), []
    for f in fields(config):
        kind, limits, worth, choices, file = hints[f.name], None, WorthTrying(), None, False
        if get_origin(kind) is Annotated:
            kind, *extras = get_args(kind)
            limits = next((e for e in extras if isinstance(e, Range)), None)
            worth = next((e for e in extras if isinstance(e, WorthTrying)), worth)
            choices = next((e for e in extras if isinstance(e, Choices)), None)
            file = any(isinstance(e, NamesFile) for e in extras)
        result.append((Setting(f.name, kind, limits, config, worth, file), choices))
    return tuple(result)


def not_default(config: Any) -> tuple[tuple[str, Any], ...]:
    """Returns the settings that differ from their default, as (name, default); those within a nested config are not
    compared."""
    standard = type(config)()
    values = ((s.name, getattr(standard, s.name), getattr(config, s.name)) for s in settings(type(config)))
    return tuple((name, default) for name, default, own in values if not is_dataclass(own) and own != default)


def files_named(config: type, values: Mapping[str, Any]) -> dict[str, str]:
    """Returns the files and folders that plain values of a config name, by setting; none of those that are empty."""
    listed = (s.name for s in settings(config) if s.names_file)
    return {name: value for name in listed if isinstance(value := values.get(name), str) and value}


def alternatives(config: Any) -> tuple[tuple[str, Any], ...]:
    """Returns what to try in place of each setting's present value, as (name, value): its default where that is another
    one, then what is worth trying, within the range. Each once, the defaults first."""
    found = dict.fromkeys(not_default(config))
    for setting in settings(type(config)):
        scaled = [_within(setting, getattr(config, setting.name) * factor) for factor in setting.worth_trying.times]
        for value in (*scaled, *setting.worth_trying.values):
            if get_origin(setting.type) is not Literal or value in get_args(setting.type):
                found[setting.name, value] = None
    return tuple((name, value) for name, value in found if value != getattr(config, name))


def _within(setting: Setting, value: float) -> float:
    """The nearest value that the setting may have."""
    inside = min(max(value, setting.range.low), setting.range.high) if setting.range else value
    return round(inside) if setting.type is int else inside


def check(config: Any, where: str) -> None:
    """InputError where a value, here or in a nested config, is out of its range. `where` is the flag's prefix."""
    if fault := _fault(config):
        name, what = fault
        raise InputError(f"--{where}{name.replace('_', '-')} {what}")


def checked(config: C) -> C:
    """Returns the config, for estimators that are built in Python. Raises InputError as `check`, with the names that
    Python has."""
    if fault := _fault(config):
        name, what = fault
        raise InputError(f"{type(config).__name__}.{name} {what}")
    return config


def _fault(config: Any) -> tuple[str, str] | None:
    """Returns which value is out of its range, by its name, and how; None where none is."""
    for setting in settings(type(config)):
        value: Any = getattr(config, setting.name)
        limits = setting.range
        if is_dataclass(value):
            if inner := _fault(value):
                return f"{setting.name}.{inner[0]}", inner[1]
        elif limits and (not isinstance(value, Real) or isinstance(value, bool)):
            return setting.name, f"is {str(value)[:60]!r}, give a number from {limits.low:g} to {limits.high:g}"
        elif limits and setting.type is int and not isinstance(value, Integral):
            return setting.name, f"is {value:g}, give a whole number from {limits.low:g} to {limits.high:g}"
        elif limits and not limits.low <= _float(value) <= limits.high:
            return setting.name, f"is {_float(value):g}, give a value from {limits.low:g} to {limits.high:g}"
        elif setting.type is bool and value not in (True, False):
            return setting.name, f"is {str(value)[:60]!r}, give True or False"
        elif setting.names_file and not isinstance(value, str):
            return setting.name, f"is {str(value)[:60]!r}, give the name of a file or folder as text"
        elif get_origin(setting.type) is Literal and value not in (names := get_args(setting.type)):
            return setting.name, f"is {str(value)[:60]!r}, choose from {', '.join(map(str, names))}"
    return None


def from_plain(config: type, values: Any, where: str) -> Any:
    """A config of plain values, as YAML has them; defaults for those that are not there. Ranges are left to `check`.

    `where` names the mapping in the InputError for one that is of the wrong type or that the config does not have.
    """
    if not isinstance(values, dict):
        raise InputError(f"{where} is {str(values)[:40]!r}, not settings by name")
    known = {setting.name: setting for setting in settings(config)}
    if unknown := sorted(map(str, values.keys() - known.keys())):  # YAML's names may be of any kind
        raise InputError(f"{where} has {unknown[0][:60]!r}, which is no setting: choose from {', '.join(known)}")
    return config(**{name: _plain_value(known[name], value, f"{where}.{name}") for name, value in values.items()})


def _plain_value(setting: Setting, value: Any, where: str) -> Any:
    if is_dataclass(setting.type):
        return from_plain(setting.type, value, where)  # type: ignore[arg-type]
    if get_origin(setting.type) is Literal:
        fits, what = value in get_args(setting.type), f"one of {', '.join(map(str, get_args(setting.type)))}"
    else:
        number = isinstance(value, int) and not isinstance(value, bool)
        fits = number if setting.type is int else isinstance(value, setting.type) or (setting.type is float and number)
        what = {bool: "true or false", int: "an integer", float: "a number"}.get(setting.type, "text")
    if not fits:
        raise InputError(f"{where} is {str(value)[:40]!r}, not {what}")
    return _float(value) if setting.type is float else value


def _float(value: Any) -> float:
    """Returns the float of a number; an infinite one of an integer that is too large for a float."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


@cache
def _field_docs(config: type) -> dict[str, str]:
    """By field; parsed from the source, when somebody asks. Those of the dataclasses that this one extends included."""
    docs = {}
    for base in reversed(config.__mro__):
        if "__annotations__" in vars(base):
            docs |= _own_docs(base)
    return docs


def _own_docs(config: type) -> dict[str, str]:
    try:
        source = inspect.getsource(config)
    except (OSError, TypeError):  # typed at a prompt
        return {}
    body, docs = ast.parse(textwrap.dedent(source)).body[0].body, {}  # type: ignore[attr-defined]
    for statement, following in pairwise(body):
        if isinstance(statement, ast.AnnAssign) and isinstance(following, ast.Expr):
            docs[statement.target.id] = inspect.cleandoc(following.value.value)  # type: ignore[attr-defined]
    return docs
