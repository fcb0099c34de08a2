from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ispom_app.session.state import FeatureState, State


@dataclass(frozen=True)
class Greetings(FeatureState):
    count: int = 0

    def page(self, state: State) -> dict[str, Any]:
        return {"greetings": self.count}
