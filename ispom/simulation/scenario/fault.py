"""What a fault is: a value that makes another sequence of a sequence, whose truth stays exact."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Literal, Protocol

import numpy as np

from ispom.settings import Range
from ispom.simulation.cameras import NOISE_SIGMA
from ispom.types import Frame, FrameName, Image, Measurement, Sequence

Cameras = Literal["all", "video", "left", "right"]
Change = Callable[[Image, FrameName, int], Image]
"""The image of a camera at a time [ns] to another one of the same size."""


class Fault(Protocol):
    """A frozen dataclass of plain values."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        """The sequence with this fault; the same for the same seed."""
        ...


@dataclass(frozen=True, kw_only=True)
class Spell:
    """When a fault is there."""

    from_s: Annotated[float, Range(0, 3600)] = 0.0
    """Since the first exposure [s]."""
    until_s: Annotated[float, Range(0, 3600)] = 3600.0

    def covers(self, sequence: Sequence, time_ns: int) -> bool:
        since_s = (time_ns - int(sequence.times_ns[0])) * 1e-9
        return self.from_s <= since_s < self.until_s


def with_images(sequence: Sequence, change: Change, spell: Spell, cameras: Cameras = "all") -> Sequence:
    """With the images of these cameras changed, during the spell."""

    def changed(image: Image, camera: FrameName, time_ns: int) -> Image:
        return change(image, camera, time_ns) if cameras in ("all", camera) else image

    def load(i: int) -> Measurement:
        seen = sequence.load(i)
        if not spell.covers(sequence, seen.time_ns):
            return seen
        if not isinstance(seen, Frame):
            return seen
        return seen.with_images(**{name: changed(image, name, seen.time_ns) for name, image in seen.images.items()})

    return replace(sequence, load=load)


def random_of(*what: object) -> np.random.Generator:
    """The same numbers for the same values."""
    return np.random.Generator(np.random.SFC64(zlib.crc32(repr(what).encode())))


def read_out(light: np.ndarray, noise_left: float, *what: object) -> Image:
    """uint8 of grey levels (H, W, 3), with as much noise added as a sensor has and `noise_left` (a share) lacks."""
    sigma = NOISE_SIGMA * float(np.sqrt(max(0.0, 1 - noise_left**2)))
    noise = random_of(*what).standard_normal(light.shape, np.float32)
    return np.clip(light + np.float32(sigma) * noise + 0.5, 0, 255).astype(np.uint8)
