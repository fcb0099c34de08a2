"""Which settings can be swept, which values are proposed for one, and the plan of a sweep with a person's values."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, fields
from itertools import islice
from typing import Any, Literal, get_args, get_origin

import yaml

from ispom.errors import InputError
from ispom.estimators.program.estimator import ProgramConfig
from ispom.methods import Config, method, with_dependencies
from ispom.settings import Setting, check, from_plain, settings

from ...engine.options import SourceOptions

Value = bool | int | float | str
FEWEST, MOST = 2, 6
FACTORS = (0.25, 0.5, 1.0, 2.0)
"""Proposed values of a setting, as factors of its present value."""
STEPS = 4
"""Values over a whole range, where nothing can be multiplied."""
DIGITS = 2
"""Significant digits of a proposed number."""
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
    if found.range is None:
        raise InputError(f"{name}.{setting} has no range: give its values")
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
        count_text = f"{len(values)} value{'' if len(values) == 1 else 's'}"
        raise InputError(f"{flag} is to be swept over {count_text}: give {FEWEST} to {MOST} that differ")
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


QUANTITIES = ("ate_m", "ate_percent", "t_err_percent", "rpe_deg", "located_percent")


def plan_text(swept: Swept, source: str, options: SourceOptions, config: Config) -> str:
    """A line for each value; `config` has all other settings. InputError for what a plan cannot say."""
    if options.camera is not None:
        raise InputError(
            "a sweep takes the calibration that lies beside the images, not that of --camera: write it there"
        )
    others = _others(swept, config)
    setting = swept.setting.replace("_", "-")
    content = {
        "title": f"{swept.flag}: {', '.join(map(shown, swept.values))}",
        "sources": [source],
        "seeds": options.seed,
        "lines": {
            f"{setting} {shown(value)}": {
                "method": swept.method,
                "settings": others | {f"{swept.method}.{swept.setting}": value},
            }
            for value in swept.values
        },
        "quantities": list(QUANTITIES),
        "stereo_every": options.stereo_every,
        "video_scale": options.video_scale,
        "max_exposures": options.max_exposures,
    }
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)


def _others(swept: Swept, config: Config) -> dict[str, Value]:
    """What is not the default, of the method and of those that it asks."""
    found: dict[str, Value] = {}
    for name in with_dependencies([swept.method]):
        usual: Any = method(name).config()
        for field in fields(usual):
            value: Any = getattr(config.of(name), field.name)
            if value == getattr(usual, field.name) or (name, field.name) == (swept.method, swept.setting):
                continue
            if not isinstance(value, Value):
                raise InputError(f"a sweep cannot take --{name}.{field.name.replace('_', '-')}: restore its default")
            found[f"{name}.{field.name}"] = value
    return found
