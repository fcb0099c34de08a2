"""Which quantities the time dock plots."""

from __future__ import annotations

from dataclasses import dataclass

from ...session.state import FeatureState
from .plotting import DEFAULT_PLOTS


@dataclass(frozen=True)
class Plots(FeatureState):
    names: tuple[str, ...] = DEFAULT_PLOTS
    """METHOD.KEY, or KEY for all methods."""

    def reduce(self, event: object) -> Plots:
        return self  # also over another source
