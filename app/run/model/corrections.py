"""What the methods of a run found to be wrong with its calibration, as their latest Steps say, and the rig with it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from ispom.errors import InputError
from ispom.evaluation.corrected_rig import Corrected, corrected
from ispom.geometry import Array
from ispom.io.rig import rig_text
from ispom.types import Rig, Step


@dataclass
class CorrectionMemory:
    """The newest of each kind."""

    _found: dict[str, Array] = field(default_factory=dict)

    def add(self, steps: Iterable[Step]) -> None:
        """Of the modern methods alone: those say how sure they are."""
        for step in steps:
            if any(name.endswith("_covariance") for name in step.calibration):
                self._found |= step.calibration

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
