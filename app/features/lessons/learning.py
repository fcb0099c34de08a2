"""Where a lesson is, as a value; and what may be seen of the session while its question is open."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from ispom.types import Tracks

from .lesson import Lesson, Step
from .reveal import Revealed

if TYPE_CHECKING:
    from ...session.state import State

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
    """The exposure whose picture is pointed at, and its tracks; None where the question has none."""

    @property
    def step(self) -> Step:
        return self.lesson.steps[self.place]

    @property
    def open(self) -> bool:
        """Whether the answer is not known yet."""
        return self.phase != "revealed"

    @property
    def covers(self) -> bool:
        """Whether numbers, checks and settings are out of sight."""
        return self.open and not self.step.tools


def covered(state: State) -> State:
    """The state as people may see it: while a question is open, nothing in it gives the answer away."""
    learning = state.lesson
    if learning is None or not learning.covers:
        return state
    record = state.displayed and replace(state.displayed, steps=(), errors_m={}, statuses={})
    activity = state.activity and replace(state.activity, text="getting the question ready")
    if learning.phase == "running":
        activity = state.activity and replace(state.activity, text="running")
    return replace(
        state,
        source="",
        name=learning.lesson.title,
        notes=(),
        displayed=record,
        activity=activity,
        plots=(),
        sweep=None,
        branches=state.branches[:1],
    )
