"""Images that show nothing, in colour, and of one camera alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ispom.testing.trial import Numbered, Trial, Walk, walked
from ispom.types import FRAME_KINDS, Frame, Image, Status, as_grey

BLANK = {"without texture": 128, "all black": 0, "all white": 255}
FEW = 6
"""Measurements; enough for a method to come to the end of what it can wait for."""


def check_no_texture(trial: Trial, walk: Walk) -> None:
    """No exception, and no claim to track where nothing was ever seen."""
    built, middle = walk.built, len(walk.steps) // 2
    for how, level in BLANK.items():
        seen = [_changed(n, lambda image, level=level: np.full_like(image, level), how) for n in trial.measurements]
        for numbered, step in zip(seen, walked(built, seen[: 2 * FEW]).steps, strict=False):
            trial.require(step.status is not Status.TRACKING, "tracks in images that show nothing", numbered.place)
        dark = walked(built, seen[middle : middle + FEW], walk.states[middle])
        walked(built, trial.measurements[middle + FEW : middle + 2 * FEW], dark.states[-1])


def check_colour(trial: Trial) -> None:
    """RGB images where the others are grey, and the other way round."""
    seen = [_changed(n, _other_channels, "with the other number of channels") for n in trial.measurements[: 2 * FEW]]
    walked(trial.build(), seen)


def check_cameras_alone(trial: Trial) -> None:
    """A rig that has no cameras but those that the method uses."""
    rig, used = trial.rig, trial.method.sensors & FRAME_KINDS
    if used == {"video"}:
        alone = rig.changed(left=None, right=None)
    elif used == {"stereo"}:
        alone = rig.changed(video=None)
    else:
        return
    walked(trial.build(rig=alone), trial.measurements[:FEW])


def _changed(numbered: Numbered, change: Callable[[Image], Image], how: str) -> Numbered:
    seen = numbered.measurement
    if not isinstance(seen, Frame):
        return numbered
    return numbered.like(seen.with_images(**{name: change(image) for name, image in seen.images.items()}), how)


def _other_channels(image: Image) -> Image:
    return np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else as_grey(image)
