"""Corrections of the calibration by the methods of a run, from their latest Steps, and the corrected rig."""

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
"""Number of frames that are searched for the newest corrections. Methods report them at each of their keyframes."""


class Records(Protocol):
    """Frames by their number."""

    def __getitem__(self, index: int, /) -> ExposureRecord: ...


@dataclass
class CorrectionMemory:
    """The newest correction of each kind."""

    _found: Corrections = field(default_factory=Corrections)

    def add(self, steps: Iterable[Step]) -> None:
        """Takes the corrections of the modern methods only: these report standard deviations."""
        for step in steps:
            if step.calibration.has_covariance:
                self._found = self._found.updated(step.calibration)

    def of(self, rig: Rig) -> Corrected | None:
        """Returns the corrected rig; None where no method corrected anything."""
        try:
            return corrected(rig, self._found)
        except InputError:
            return None


def corrected_text(found: Corrected) -> str:
    """Returns a rig.yaml with the corrections and their standard deviations in comments above it."""
    lines = ["# The rig as the methods corrected it; each correction with its standard error:"]
    lines += [f"# {finding}" for finding in found.findings]
    return "\n".join(lines) + "\n" + rig_text(found.rig)


def corrected_by(records: Records, index: int, rig: Rig) -> str:
    """Returns a rig.yaml with the corrections of the methods up to frame `index`. Without any, it is the original rig,
    and a comment says so."""
    memory = CorrectionMemory()
    for i in range(max(0, index + 1 - RECENT), index + 1):
        memory.add(records[i].steps)
    found = memory.of(rig)
    return f"# No method had corrected anything by then.\n{rig_text(rig)}" if found is None else corrected_text(found)
