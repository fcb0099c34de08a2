"""The sweep that was begun last."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...session.state import FeatureState, State
from .sweep import Sweep
from .values import shown


@dataclass(frozen=True)
class SweepState(FeatureState):
    sweep: Sweep | None = None

    def reduce(self, event: object) -> SweepState:
        return self  # also over another source

    def page(self, state: State) -> dict[str, Any]:
        """Its folder, how far it is, and the errors of the runs that are over, by value."""
        sweep = self.sweep
        if sweep is None:
            return {"sweep": None}
        errors = {shown(o.value): (o.values or {}).get("ate_m") for o in sweep.outcomes.values()}
        found = {"name": sweep.name, "share": round(sweep.share, 3), "ended": sweep.ended, "ate_m": errors}
        return {"sweep": found}
