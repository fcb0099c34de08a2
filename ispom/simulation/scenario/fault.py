"""The contract of faults, which change a sequence and keep its ground truth exact, and faults of times and clocks."""

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
        """Returns the sequence with this fault; the same for the same seed."""
        ...


@dataclass(frozen=True, kw_only=True)
class Spell:
    """When a fault is there."""

    from_s: Annotated[float, Range(0, 3600)] = 0.0
    """Since the first frame [s]."""
    until_s: Annotated[float, Range(0, 3600)] = 3600.0

    def covers(self, sequence: Sequence, time_ns: int) -> bool:
        since_s = (time_ns - int(sequence.times_ns[0])) * 1e-9
        return self.from_s <= since_s < self.until_s


def with_images(sequence: Sequence, change: Change, spell: Spell, cameras: Cameras = "all") -> Sequence:
    """Changes the images of these cameras during the fault."""

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
    """Returns the same generator for the same values."""
    return np.random.Generator(np.random.SFC64(zlib.crc32(repr(what).encode())))


def read_out(light: np.ndarray, noise_left: float, *what: object) -> Image:
    """uint8 of grey levels (H, W) or (H, W, 3), with as much noise as a sensor has and `noise_left` (a share) lacks."""
    sigma = NOISE_SIGMA * float(np.sqrt(max(0.0, 1 - noise_left**2)))
    noise = random_of(*what).standard_normal(light.shape, np.float32)
    return np.clip(light + np.float32(sigma) * noise + 0.5, 0, 255).astype(np.uint8)


@dataclass(frozen=True, kw_only=True)
class Dropped(Spell):
    """Frames that never come."""

    kind: Literal["video", "stereo"] = "video"
    share: Annotated[float, Range(0, 0.95)] = 0.2
    """Share of the frames of this kind, the first one excluded."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        gone = set(_chosen(self, sequence, seed, "dropped").tolist())
        remaining = [i for i in range(len(sequence)) if i not in gone]
        prepare = sequence.prepare
        return replace(
            sequence,
            times_ns=sequence.times_ns[remaining],
            kinds=tuple(sequence.kinds[i] for i in remaining),
            load=lambda i: sequence.load(remaining[i]),
            prepare=None if prepare is None else lambda i: prepare(remaining[i]),
        )


@dataclass(frozen=True, kw_only=True)
class Repeated(Spell):
    """Frames that show the images of the one before, as new."""

    kind: Literal["video", "stereo"] = "video"
    share: Annotated[float, Range(0, 0.95)] = 0.2
    """Share of the frames of this kind, the first one excluded."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        again = set(_chosen(self, sequence, seed, "repeated").tolist())
        shown, last = np.arange(len(sequence)), -1
        for i in (i for i, kind in enumerate(sequence.kinds) if kind == self.kind):
            last = last if i in again else i
            shown[i] = last

        def load(i: int) -> Measurement:
            seen = sequence.load(int(shown[i]))
            return replace(seen, time_ns=int(sequence.times_ns[i]))

        return replace(sequence, load=load)


@dataclass(frozen=True, kw_only=True)
class Clock:
    """The video camera's clock against the stereo pair's."""

    late_s: Annotated[float, Range(-1, 1)] = 0.02
    """Delay of the frames after their time stamps [s]."""
    drift: Annotated[float, Range(-0.1, 0.1)] = 0.0
    """Further delay, as a share of the time since the first frame."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        return sequence.with_video_later(-self.late_s, -self.drift)


@dataclass(frozen=True, kw_only=True)
class Exchanged(Spell):
    """The left image is given as the right one, and the right one as the left one."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        def load(i: int) -> Measurement:
            seen = sequence.load(i)
            if isinstance(seen, Frame) and seen.kind == "stereo" and self.covers(sequence, seen.time_ns):
                return seen.with_images(left=seen.right, right=seen.left)
            return seen

        return replace(sequence, load=load)


def _chosen(fault: Dropped | Repeated, sequence: Sequence, seed: int, name: str) -> np.ndarray:
    """Returns (K,) frames, exactly the share of those during the fault, in order."""
    own = [i for i, kind in enumerate(sequence.kinds) if kind == fault.kind][1:]
    own = [i for i in own if fault.covers(sequence, int(sequence.times_ns[i]))]
    count = round(fault.share * len(own))
    return np.sort(random_of(name, seed, fault.kind).permutation(np.array(own, int))[:count])
