"""Which integration is looked at step by step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...session.state import FeatureState, State
from .integration import Integration


@dataclass(frozen=True)
class IntegrationSteps(FeatureState):
    shown: Integration | None = None

    def page(self, state: State) -> dict[str, Any]:
        return {"integration": None if self.shown is None else [self.shown.method, self.shown.stage]}
