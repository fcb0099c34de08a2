"""Checks with other inputs: changed settings, images without texture or in colour, and a rig with fewer cameras."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import is_dataclass, replace
from typing import Any, Literal, get_args, get_origin

import numpy as np

from ispom.settings import Setting, check, settings
from ispom.testing.trial import Numbered, Trial, Walk, failing_as, walked
from ispom.types import Exposure, Image, Rig, Status, StereoPair, VideoFrame, as_grey

NAME = re.compile(r"[a-z][a-z0-9_-]*(\.[a-z0-9_-]+)*")
CHANGED = 3
"""Number of frames with another setting, and then with the original settings."""


def check_declared(trial: Trial) -> None:
    """Checks name, cameras and reference, and that a form can show the settings, with defaults inside their ranges."""
    method, config = trial.method, trial.settings
    trial.require(NAME.fullmatch(method.name), "has a name that is not of small letters, digits, _, - and dots")
    trial.require(method.needs and method.needs <= {"video", "stereo"}, "needs neither video nor stereo frames")
    trial.require(method.source.strip(), "gives no reference in Method.source")
    trial.require(trial.frames and method.possible(trial.rig), "lacks cameras: give a sequence that has them")
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
    """Checks forks: changes each setting in the middle of the run, and changes it back some frames later."""
    middle = len(walk.steps) // 2
    ahead = trial.frames[middle:]
    for setting in settings(type(trial.settings)):
        for value in _others(setting, getattr(trial.settings, setting.name)):
            how = f"with {setting.name.replace('_', '-')} {value} from there on"
            seen = [numbered.like(numbered.frame, how) for numbered in ahead[:CHANGED]]
            built = trial.build(replace(trial.settings, **{setting.name: value}))
            changed = walked(built, seen, walk.states[middle])
            built.finish(changed.states[-1], seen[-1].place)
            back = [
                numbered.like(numbered.frame, f"with {setting.name} changed and changed back")
                for numbered in ahead[CHANGED : 2 * CHANGED]
            ]
            walked(walk.built, back, changed.states[-1])


def _others(setting: Setting, value: Any) -> Iterator[Any]:
    """Yields the values of a setting that differ most from this one."""
    if setting.type is bool:
        yield not value
    elif get_origin(setting.type) is Literal:
        yield from (other for other in get_args(setting.type) if other != value)
    elif setting.range is not None:
        kind = int if setting.type is int else float
        yield from (kind(limit) for limit in (setting.range.low, setting.range.high) if limit != value)


BLANK = {"without texture": 128, "all black": 0, "all white": 255}
FEW = 6
"""Frames; enough for the patience of a method to run out."""


def check_no_texture(trial: Trial, walk: Walk) -> None:
    """Checks that images without texture raise nothing, and that a method does not claim to track in them."""
    built, middle = walk.built, len(walk.steps) // 2
    for how, level in BLANK.items():
        seen = [_changed(n, lambda image, level=level: np.full_like(image, level), how) for n in trial.frames]
        for numbered, step in zip(seen, walked(built, seen[: 2 * FEW]).steps, strict=False):
            trial.require(step.status is not Status.TRACKING, "tracks in images without texture", numbered.place)
        dark = walked(built, seen[middle : middle + FEW], walk.states[middle])
        walked(built, trial.frames[middle + FEW : middle + 2 * FEW], dark.states[-1])


def check_colour(trial: Trial) -> None:
    """Checks RGB images where the others are grey, and grey ones where they are RGB."""
    seen = [_changed(n, _other_channels, "with the other number of channels") for n in trial.frames[: 2 * FEW]]
    walked(trial.build(), seen)


def check_cameras_alone(trial: Trial) -> None:
    """Checks a rig that has only the cameras that the method needs."""
    rig, needs = trial.rig, trial.method.needs
    if needs == {"video"}:
        reduced = Rig(video=rig.video, rig_from_video=rig.rig_from_video)
    elif needs == {"stereo"}:
        reduced = Rig(None, rig.left, rig.right, rig.rig_from_video, rig.rig_from_left, rig.rig_from_right)
    else:
        return
    walked(trial.build(rig=reduced), trial.frames[:FEW])


def _changed(numbered: Numbered, change: Callable[[Image], Image], how: str) -> Numbered:
    exposure: Exposure = numbered.frame
    if isinstance(exposure, VideoFrame):
        return numbered.like(VideoFrame(exposure.time_ns, change(exposure.image)), how)
    return numbered.like(StereoPair(exposure.time_ns, change(exposure.left), change(exposure.right)), how)


def _other_channels(image: Image) -> Image:
    return np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else as_grey(image)
