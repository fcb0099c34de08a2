"""How a run goes so far, method by method, as a value of constant size."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from ispom.types import Status, Step


@dataclass(frozen=True)
class MethodTally:
    """Of the frames that a method used."""

    exposures: int = 0
    lost: int = 0
    key_frames: int = 0
    provisional: bool = False
    """Whether the latest pose waits for the first fit of an integration."""

    def after(self, step: Step) -> MethodTally:
        return replace(
            self,
            exposures=self.exposures + 1,
            lost=self.lost + (step.status == Status.LOST),
            key_frames=self.key_frames + step.key_frame,
            provisional=step.provisional,
        )


@dataclass(frozen=True)
class Tally:
    """By method."""

    methods: Mapping[str, MethodTally] = field(default_factory=dict)

    def after(self, steps: Iterable[Step]) -> Tally:
        found = dict(self.methods)
        for step in steps:
            found[step.method] = found.get(step.method, MethodTally()).after(step)
        return Tally(found)
