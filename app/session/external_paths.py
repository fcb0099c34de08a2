"""Trajectories of other programs, and their errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from ispom.evaluation.trajectory_error import TrajectoryError

from ..engine.events import Opened
from ..engine.external_trajectories.placed import ExternalTrajectory
from .state import Event, FeatureState, Resumed


@dataclass(frozen=True, eq=False)
class ExternalPaths(FeatureState):
    all: tuple[ExternalTrajectory, ...] = ()
    errors: Mapping[str, TrajectoryError] = field(default_factory=dict)
    """By name, over the frames that are computed."""

    def reduce(self, event: Event) -> ExternalPaths:
        opened = event.opened if isinstance(event, Resumed) else event
        return replace(self, all=opened.external_trajectories) if isinstance(opened, Opened) else self
