"""What a person may ask of lessons."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Learn:
    """Begin a lesson, or go on with it."""

    name: str
    place: int | None = None
    """The step, counted from 0; None for the first whose answer was not revealed yet."""


@dataclass(frozen=True)
class TurnTo:
    """Another step of the lesson that is on, counted from 0."""

    place: int


@dataclass(frozen=True)
class Reveal:
    """Run what the open question is about, and show what is right."""


@dataclass(frozen=True)
class EndLesson:
    """Back to the page as it is without a lesson."""


OfLessons = Learn | TurnTo | Reveal | EndLesson
