"""How a run goes so far, method by method, as a value of constant size."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from ispom.types import Status, Step


@dataclass(frozen=True)
class MethodTally:
    """Of the exposures that a method used."""

    exposures: int = 0
    lost: int = 0
    key_frames: int = 0
    seconds: float = 0.0
    """Computing time, in all."""
    with_error: int = 0
    """Exposures whose distance from the truth is known."""
    squared_error_m2: float = 0.0
    """Sum over those."""
    error_m: float | None = None
    """The latest."""

    @property
    def rmse_m(self) -> float | None:
        """Root mean square of the live estimates' distances from the truth; None where no truth is known."""
        return math.sqrt(self.squared_error_m2 / self.with_error) if self.with_error else None

    @property
    def ms(self) -> float | None:
        """Mean computing time of an exposure [ms]."""
        return 1000 * self.seconds / self.exposures if self.exposures else None

    def after(self, step: Step, error_m: float | None) -> MethodTally:
        counted = replace(
            self,
            exposures=self.exposures + 1,
            lost=self.lost + (step.status == Status.LOST),
            key_frames=self.key_frames + step.key_frame,
            seconds=self.seconds + sum(step.seconds.values()),
        )
        if error_m is None:
            return counted
        squared = self.squared_error_m2 + error_m**2
        return replace(counted, with_error=self.with_error + 1, squared_error_m2=squared, error_m=error_m)


@dataclass(frozen=True)
class Tally:
    """By method."""

    methods: Mapping[str, MethodTally] = field(default_factory=dict)

    def after(self, steps: Iterable[Step], errors_m: Mapping[str, float]) -> Tally:
        found = dict(self.methods)
        for step in steps:
            found[step.method] = found.get(step.method, MethodTally()).after(step, errors_m.get(step.method))
        return Tally(found)
