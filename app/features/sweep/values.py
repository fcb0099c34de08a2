"""Which settings can be swept, which values are proposed for one, and what a person's values are worth."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any, Literal, get_args, get_origin

from ispom.errors import InputError
from ispom.estimators.program import ProgramConfig
from ispom.methods import Config, method
from ispom.settings import Setting, check, from_plain, settings

Value = bool | int | float | str
FEWEST, MOST = 2, 6
FACTORS = (0.25, 0.5, 1.0, 2.0)
"""Of the value that a setting has: these are proposed."""
STEPS = 4
"""Values over a whole range, where nothing can be multiplied."""
DIGITS = 2
"""Of a proposed number."""
LONGEST = 30
"""Characters of a number: what is longer may be more than any float."""
WORDS = {"on": True, "true": True, "yes": True, "off": False, "false": False, "no": False}


@dataclass(frozen=True)
class Swept:
    """A setting of a method, and the values that it takes."""

    method: str
    setting: str
    """As a field of the method's config."""
    values: tuple[Value, ...]

    @property
    def flag(self) -> str:
        return f"{self.method}.{self.setting.replace('_', '-')}"


def offered(name: str) -> tuple[Setting, ...]:
    """The settings of a method that have a range, are on or off, or are a choice of words; none of a program that the
    command line names, for no other process knows it."""
    config = method(name).config
    return () if issubclass(config, ProgramConfig) else tuple(s for s in settings(config) if _choosable(s))


def proposed(name: str, setting: str, config: Config) -> tuple[Value, ...]:
    """Of a setting: all where these are few; else around the value that it has, within its range."""
    found, value = _setting(name, setting), getattr(config.of(name), setting)
    if found.type is bool:
        return False, True
    if get_origin(found.type) is Literal:
        return tuple(islice(get_args(found.type), MOST))
    assert found.range is not None
    low, high = found.range.low, found.range.high
    around = _distinct(found.type, (min(max(value * factor, low), high) for factor in FACTORS), value)
    if len(around) >= FEWEST:
        return around
    return _distinct(found.type, (low + (high - low) * step / (STEPS - 1) for step in range(STEPS)))


def parsed(name: str, setting: str, text: str) -> Swept:
    """The values of a text, such as `100, 200, 400`; InputError where they are not a few that the setting can have."""
    found, flag = _setting(name, setting), f"{name}.{setting.replace('_', '-')}"
    words = re.split(r"[\s,;]+", text.strip()) if text.strip() else []
    values = tuple(dict.fromkeys(_value(found, word, flag) for word in words))
    if not FEWEST <= len(values) <= MOST:
        given = f"{len(values)} value{'' if len(values) == 1 else 's'}"
        raise InputError(f"{flag} is to be swept over {given}: give {FEWEST} to {MOST} that differ")
    for value in values:
        check(from_plain(method(name).config, {setting: value}, name), f"{name}.")
    return Swept(name, setting, values)


def shown(value: Value) -> str:
    """As a person writes it."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, float):
        brief = f"{value:g}"
        return brief if float(brief) == value else repr(value)  # two values never look the same
    return str(value)


def _choosable(setting: Setting) -> bool:
    ranged = setting.range is not None and setting.type in (int, float)
    return ranged or setting.type is bool or get_origin(setting.type) is Literal


def _setting(name: str, setting: str) -> Setting:
    found = next((s for s in offered(name) if s.name == setting), None)
    if found is None:
        raise InputError(f"{setting[:60]!r} is no setting of {name} that can be swept: choose one of the list")
    return found


def _value(setting: Setting, word: str, flag: str) -> Value:
    try:
        if setting.type is bool:
            return WORDS[word.lower()]
        if get_origin(setting.type) is Literal:
            return next(choice for choice in get_args(setting.type) if str(choice) == word)
        if len(word) > LONGEST:
            raise ValueError
        return setting.type(word)
    except (ValueError, KeyError, StopIteration):
        what = {bool: "on or off", int: "an integer", float: "a number"}.get(setting.type)
        what = what or f"one of {', '.join(map(str, get_args(setting.type)))}"
        raise InputError(f"{flag}: {word[:40]!r} is not {what}") from None


def _distinct(kind: Any, numbers: Iterator[float], exact: float | None = None) -> tuple[Value, ...]:
    """Each once, rounded, but for one."""
    rounded = (number if number == exact else float(f"{number:.{DIGITS}g}") for number in numbers)
    return tuple(dict.fromkeys(kind(round(number) if kind is int else number) for number in rounded))
