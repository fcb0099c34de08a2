"""What the page shows of an examination."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ispom.evaluation.doctor.diagnosis import Diagnosis

from ...engine.run_events.stretch import Stretch
from ...session.branches.state import Branches
from ...session.state import FeatureState, State
from .job import Progress


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
    branch: int = 0
    """The number of the branch that is examined."""
    taken_s: int = 0
    """Whole seconds that it has taken so far, without the compilation before it."""
    limit_s: int = 0
    """Seconds after which no new suspect is examined."""

    def at(self, state: State) -> Examined:
        """Returns it where it is of the branch that is shown, and else that there is none."""
        return self if self.branch == state[Branches].shown else Examined()

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
