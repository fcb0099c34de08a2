"""What the methods of a run found to be wrong with its calibration, as their latest Steps say, and the rig with it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Protocol

from ispom.errors import InputError
from ispom.evaluation.corrected_rig import Corrected, corrected
from ispom.io.rig import rig_text
from ispom.types import Corrections, Rig, Step

from ..history.record import ExposureRecord

RECENT = 400
"""Frames that are looked through for the newest corrections: methods say them at each of their keyframes."""


class Records(Protocol):
    """Frames by their number."""

    def __getitem__(self, index: int, /) -> ExposureRecord: ...


@dataclass
class CorrectionMemory:
    """The newest of each kind."""

    _found: Corrections = field(default_factory=Corrections)

    def add(self, steps: Iterable[Step]) -> None:
        """Of the modern methods alone: those say how sure they are."""
        for step in steps:
            if step.calibration.has_covariance:
                self._found = self._found.updated(step.calibration)

    def of(self, rig: Rig) -> Corrected | None:
        """None where no method corrected anything."""
        try:
            return corrected(rig, self._found)
        except InputError:
            return None


def corrected_text(found: Corrected) -> str:
    """A rig.yaml, with the corrections and their standard errors above it."""
    lines = ["# The rig as the methods corrected it; each correction with its standard error:"]
    lines += [f"# {finding}" for finding in found.findings]
    return "\n".join(lines) + "\n" + rig_text(found.rig)


def corrected_by(records: Records, index: int, rig: Rig) -> str:
    """A rig.yaml with what the methods had corrected by frame `index`: the rig as it was, and that said, where they
    had corrected nothing."""
    memory = CorrectionMemory()
    for i in range(max(0, index + 1 - RECENT), index + 1):
        memory.add(records[i].steps)
    found = memory.of(rig)
    return f"# No method had corrected anything by then.\n{rig_text(rig)}" if found is None else corrected_text(found)
