"""The condition that was looked for last."""

from __future__ import annotations

from dataclasses import dataclass

from ...engine.conditions.parser import Expression
from ...session.state import FeatureState


@dataclass(frozen=True)
class Breakpoints(FeatureState):
    marked: Expression | None = None
    """The time axis marks where it holds."""
