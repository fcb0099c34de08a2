"""What a method says about itself, and its settings: explained, in range, and changed in the middle of a run."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import is_dataclass, replace
from typing import Any, Literal, get_args, get_origin

from ispom.settings import Setting, check, settings
from ispom.testing.trial import Trial, Walk, failing_as, walked
from ispom.types import FRAME_KINDS

NAME = re.compile(r"[a-z][a-z0-9_-]*(\.[a-z0-9_-]+)*")
CHANGED = 3
"""Measurements with another setting, and then as many with the settings from before."""


def check_declared(trial: Trial) -> None:
    """A name, the cameras and a reference; settings that a form can show, with defaults inside their ranges."""
    method, config = trial.method, trial.settings
    trial.require(NAME.fullmatch(method.name), "has a name that is not of small letters, digits, _, - and dots")
    trial.require(method.sensors & FRAME_KINDS, "uses no frames of any camera")
    trial.require(method.optional <= method.sensors, "has optional sensors that it does not use")
    trial.require(method.source.strip(), "does not say in Method.source where it comes from")
    trial.require(trial.measurements and method.possible(trial.rig), "lacks cameras: give a sequence that has them")
    frozen = is_dataclass(config) and type(config).__dataclass_params__.frozen  # type: ignore[attr-defined]
    trial.require(frozen, "has settings that are no frozen dataclass")
    with failing_as(method, "has settings that cannot be listed"):
        listed = settings(type(config))
    for setting in listed:
        trial.require(setting.help, f"does not explain its setting {setting.name}: write a docstring below it")
        limited = setting.type in (bool, str) or setting.range or get_origin(setting.type) is Literal
        trial.require(limited, f"has no Range for its setting {setting.name}")
    with failing_as(method, "has a default outside its range"):
        check(config, f"{method.name}.")


def check_other_settings(trial: Trial, walk: Walk) -> None:
    """A fork changes settings on the way: the State from before is stepped on from with the others, and back."""
    middle = len(walk.steps) // 2
    ahead = trial.measurements[middle:]
    for setting in settings(type(trial.settings)):
        for value in _others(setting, getattr(trial.settings, setting.name)):
            how = f"with {setting.name.replace('_', '-')} {value} from there on"
            seen = [numbered.like(numbered.measurement, how) for numbered in ahead[:CHANGED]]
            built = trial.build(replace(trial.settings, **{setting.name: value}))
            changed = walked(built, seen, walk.states[middle])
            built.finish(changed.states[-1], seen[-1].place)
            back = [
                numbered.like(numbered.measurement, f"with {setting.name} changed and changed back")
                for numbered in ahead[CHANGED : 2 * CHANGED]
            ]
            walked(walk.built, back, changed.states[-1])


def _others(setting: Setting, value: Any) -> Iterator[Any]:
    """The values of a setting that differ most from this one."""
    if setting.type is bool:
        yield not value
    elif get_origin(setting.type) is Literal:
        yield from (other for other in get_args(setting.type) if other != value)
    elif setting.range is not None:
        kind = int if setting.type is int else float
        yield from (kind(limit) for limit in (setting.range.low, setting.range.high) if limit != value)
