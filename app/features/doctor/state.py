"""What the page shows of an examination."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ispom.evaluation.doctor.finding import Diagnosis

from ...session.state import FeatureState, State
from .job import Progress
from .stretch import Stretch


@dataclass(frozen=True, eq=False)
class Examined(FeatureState):
    """The newest examination."""

    stretch: Stretch | None = None
    """None before the first one."""
    progress: Progress | None = None
    """While it goes on."""
    diagnosis: Diagnosis | None = None
    """Once it has ended."""
    problem: str = ""
    """Why it ended without one."""

    def page(self, state: State) -> dict[str, Any]:
        """How far it is, and the keys of the causes that it found."""
        found = self.diagnosis
        return {
            "doctor": {
                "at": None if self.stretch is None else self.stretch.at,
                "running": self.progress is not None,
                "causes": None if found is None else [each.suspect.key for each in found.causes],
            }
        }
