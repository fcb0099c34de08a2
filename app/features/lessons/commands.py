"""Going through a lesson."""

from __future__ import annotations

from typing import ClassVar

from ...session.commands import PageCommand
from ...session.controller import Controller
from .service import LessonService


class LessonCommand(PageCommand, frozen=True):
    in_lessons: ClassVar[bool] = True


class Learn(LessonCommand, frozen=True):
    """Begin a lesson, or go on with it."""

    name: str
    place: int | None = None
    """The step, counted from 0; None for the first whose answer was not revealed yet."""
    keeps: ClassVar[bool] = True

    def execute(self, session: Controller) -> None:
        session.service(LessonService).enter(self.name, self.place)

    def closing(self, session: Controller) -> str:
        return _closing(session, self.name, self.place)


class TurnTo(LessonCommand, frozen=True):
    """Another step of the lesson that is on, counted from 0."""

    place: int
    keeps: ClassVar[bool] = True

    def execute(self, session: Controller) -> None:
        session.service(LessonService).turn_to(self.place)

    def closing(self, session: Controller) -> str:
        return _closing(session, None, self.place)


class Reveal(LessonCommand, frozen=True):
    """Run what the open question is about, and show what is right."""

    def execute(self, session: Controller) -> None:
        session.service(LessonService).reveal()


class EndLesson(LessonCommand, frozen=True):
    """Back to the page as it is without a lesson."""

    def execute(self, session: Controller) -> None:
        session.service(LessonService).end()


def _closing(session: Controller, lesson: str | None, place: int | None) -> str:
    return "The lesson" if session.service(LessonService).opens_a_run(lesson, place) else ""
