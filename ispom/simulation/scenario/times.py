"""Faults of when exposures come, and of what their clocks say."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np

from ispom.settings import Range
from ispom.simulation.faults import with_video_clock
from ispom.simulation.scenario.fault import Spell, random_of
from ispom.types import Measurement, Sequence


@dataclass(frozen=True, kw_only=True)
class Dropped(Spell):
    """Exposures that never come."""

    kind: Literal["video", "stereo"] = "video"
    share: Annotated[float, Range(0, 0.95)] = 0.2
    """Of those of this kind, the first one excluded."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        gone = set(_chosen(self, sequence, seed, "dropped").tolist())
        kept = [i for i in range(len(sequence)) if i not in gone]
        prepare = sequence.prepare
        return replace(
            sequence,
            times_ns=sequence.times_ns[kept],
            kinds=tuple(sequence.kinds[i] for i in kept),
            load=lambda i: sequence.load(kept[i]),
            prepare=None if prepare is None else lambda i: prepare(kept[i]),
        )


@dataclass(frozen=True, kw_only=True)
class Repeated(Spell):
    """Exposures that show the images of the one before, as new."""

    kind: Literal["video", "stereo"] = "video"
    share: Annotated[float, Range(0, 0.95)] = 0.2
    """Of those of this kind, the first one excluded."""

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
    """Frames are exposed so much after what their stamps say [s]."""
    drift: Annotated[float, Range(-0.1, 0.1)] = 0.0
    """And by this share of the time since the first exposure more."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        return with_video_clock(sequence, self.late_s, self.drift)


def _chosen(fault: Dropped | Repeated, sequence: Sequence, seed: int, name: str) -> np.ndarray:
    """(K,) exposures, exactly the share of those within the spell, in order."""
    own = [i for i, kind in enumerate(sequence.kinds) if kind == fault.kind][1:]
    own = [i for i in own if fault.covers(sequence, int(sequence.times_ns[i]))]
    count = round(fault.share * len(own))
    return np.sort(random_of(name, seed, fault.kind).permutation(np.array(own, int))[:count])
