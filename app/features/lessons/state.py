"""The lesson that is on, and what was learned so far."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from ispom.types import Tracks

from ...session.state import FeatureState, State
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

    def cover(self, state: State) -> State:
        learning = self.now
        if learning is None:
            return state
        record = state.displayed and replace(state.displayed, steps=(), errors_m={}, statuses={})
        doing = "running" if learning.phase == "running" else "getting the question ready"
        activity = state.activity and replace(state.activity, text=doing)
        return replace(state, source="", name=learning.lesson.title, notes=(), displayed=record, activity=activity)

    def address(self) -> dict[str, str]:
        return {"lesson": f"{self.now.lesson.name}:{self.now.place + 1}" if self.now else ""}
