"""The lesson that is on, and what was learned so far."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from ispom.types import Tracks

from ...session.state import FeatureState, State
from ..branches.state import Branches
from ..plots.commands import Plots
from ..sweep.sweep import SweepState
from .lesson import Lesson, Step
from .reveal import Revealed

Phase = Literal["preparing", "asking", "running", "revealed"]


@dataclass(frozen=True, eq=False)
class Learning:
    """A lesson at one of its steps."""

    lesson: Lesson
    place: int
    """Of the step, counted from 0."""
    phase: Phase = "preparing"
    revealed: Revealed | None = None
    pictured: tuple[int, Tracks] | None = None
    """The frame whose picture is pointed at, and its tracks; None where the question has none."""

    @property
    def step(self) -> Step:
        return self.lesson.steps[self.place]

    @property
    def open(self) -> bool:
        """Whether the answer is not known yet."""
        return self.phase != "revealed"

    @property
    def covers(self) -> bool:
        """Whether numbers, checks and settings are hidden."""
        return self.open and not self.step.tools


@dataclass(frozen=True)
class Lessons(FeatureState):
    now: Learning | None = None
    """The lesson that is on, and where it is."""
    progress: Mapping[str, int] = field(default_factory=dict)
    """By lesson: the steps whose answer was revealed."""

    def reduce(self, event: object) -> Lessons:
        return self  # a lesson opens its runs by itself

    @property
    def covers(self) -> bool:
        """Whether numbers, checks and settings are hidden."""
        return self.now is not None and self.now.covers


def covered(state: State) -> State:
    """The state as people may see it: while a question is open, nothing in it gives the answer away."""
    learning = state[Lessons].now
    if learning is None or not learning.covers:
        return state
    record = state.displayed and replace(state.displayed, steps=(), errors_m={}, statuses={})
    activity = state.activity and replace(state.activity, text="getting the question ready")
    if learning.phase == "running":
        activity = state.activity and replace(state.activity, text="running")
    hidden = replace(state, source="", name=learning.lesson.title, notes=(), displayed=record, activity=activity)
    branches = state[Branches]
    return hidden.having(Plots(()), SweepState(), replace(branches, all=branches.all[:1], comparison=None))
