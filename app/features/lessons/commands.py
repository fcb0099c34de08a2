"""Going through a lesson."""

from __future__ import annotations

from typing import ClassVar

from ...session.commands import PageCommand
from ...session.controller import Controller
from ...session.registry import handles
from .service import LessonService


class LessonCommand(PageCommand, frozen=True):
    in_lessons: ClassVar[bool] = True


class Learn(LessonCommand, frozen=True):
    """Begin a lesson, or go on with it."""

    name: str
    place: int | None = None
    """The step, counted from 0; None for the first whose answer was not revealed yet."""


class TurnTo(LessonCommand, frozen=True):
    """Another step of the lesson that is on, counted from 0."""

    place: int


class Reveal(LessonCommand, frozen=True):
    """Run what the open question is about, and show what is right."""


class EndLesson(LessonCommand, frozen=True):
    """Back to the page as it is without a lesson."""


def _closing(session: Controller, command: Learn | TurnTo) -> str:
    lesson = command.name if isinstance(command, Learn) else None
    return "The lesson" if session.service(LessonService).opens_a_run(lesson, command.place) else ""


@handles(Learn, closing=_closing)
def learn(session: Controller, command: Learn) -> None:
    session.service(LessonService).enter(command.name, command.place)


@handles(TurnTo, closing=_closing)
def turn_to(session: Controller, command: TurnTo) -> None:
    session.service(LessonService).turn_to(command.place)


@handles(Reveal)
def reveal(session: Controller, command: Reveal) -> None:
    session.service(LessonService).reveal()


@handles(EndLesson)
def end_lesson(session: Controller, command: EndLesson) -> None:
    session.service(LessonService).end()
