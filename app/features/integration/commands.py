"""Which integration is looked at step by step, and choosing it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...session.commands import Command
from ...session.controller import Controller
from ...session.state import FeatureState, State
from . import integration
from .integration import Integration


@dataclass(frozen=True)
class IntegrationSteps(FeatureState):
    shown: Integration | None = None

    @property
    def in_the_way(self) -> frozenset[str]:
        return frozenset() if self.shown is None else frozenset({"key_frames", "cameras", "error"})

    def page(self, state: State) -> dict[str, Any]:
        return {"integration": None if self.shown is None else [self.shown.method, self.shown.stage]}


class ShowIntegration(Command, frozen=True):
    """Look at how a method's latest fit came about, from its first stage on; without a name, no longer."""

    method: str

    def execute(self, session: Controller) -> None:
        session.store.put(IntegrationSteps(integration.shown(session.state, session.run, self.method)))


class StepIntegration(Command, frozen=True):
    """So many stages on."""

    by: int

    def execute(self, session: Controller) -> None:
        now = session.state[IntegrationSteps].shown
        session.store.put(IntegrationSteps(integration.moved(session.state, session.run, now, self.by)))
