"""The integration step by step: which fit is looked at, and moving through its stages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ispom.errors import InputError
from ispom.solvers.trajectory.stages import stages
from ispom.types import Step

if TYPE_CHECKING:
    from ...session.current_run import CurrentRun
    from ...session.state import State

SPLINE_STAGES = 3
"""The frames, the spline begun with, the spline adjusted."""
LOOKED_BACK = 200
"""Keyframes of a method among which its latest fit is looked for: without a pose it fits nothing."""


@dataclass(frozen=True)
class Integration:
    """What is looked at."""

    method: str
    stage: int = 0
    """Counted from 0; what it shows depends on the fit."""


def latest_fit(run: CurrentRun, method: str, index: int) -> tuple[int, Step] | None:
    """The frame and step of a method's latest fit up to a frame; None where there is none yet."""
    name = f"{method}.key_frame"
    if name not in run.series.quantities:
        return None
    for at in np.flatnonzero(run.series.values(name, 0, index + 1) == 1)[::-1][:LOOKED_BACK].tolist():
        for step in run.history[at].steps:
            if step.method == method and (step.segments or step.spline is not None):
                return at, step
    return None


def stage_count(step: Step) -> int:
    """How many stages a fit has; 0 where the history has given its arrays up."""
    if step.segments:
        return len(stages(step.segments[-1]))
    return SPLINE_STAGES if step.spline is not None and len(step.spline.times_ns) else 0


def shown(state: State, run: CurrentRun | None, method: str) -> Integration | None:
    """A method's integration from its first stage on, or (without a method) none. InputError for a wrong one."""
    if not method:
        return None
    _fit(state, run, method)
    return Integration(method)


def moved(state: State, run: CurrentRun | None, now: Integration | None, by: int) -> Integration:
    """So many stages on; at either end it stays. InputError where nothing is looked at."""
    if now is None:
        raise InputError("no integration is shown: choose one under Steps")
    step = _fit(state, run, now.method)
    stage = min(max(now.stage + by, 0), max(stage_count(step) - 1, 0))
    return Integration(now.method, stage)


def _fit(state: State, run: CurrentRun | None, method: str) -> Step:
    found = latest_fit(run, method, state.index) if run is not None else None
    if found is None:
        where = f"up to frame {max(state.index, 0)}"
        raise InputError(f"{method} has fitted nothing {where}: play on, or choose an integration that runs")
    return found[1]
