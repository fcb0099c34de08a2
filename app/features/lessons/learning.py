"""Where a lesson is, as a value."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ispom.types import Tracks

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
