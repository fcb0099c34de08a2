"""`ispom publish --lessons`: the runs of each lesson, and what its service would tell the page at each of its steps,
with the answers that the runs gave.

    data/site.bin            the list of lessons
    data/lesson-NAME.bin     what the page is told at each step
    data/NAME-N/             the N-th run of a lesson, as of a single published run
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ispom.errors import InputError, printable

from ....engine.playback import Builder
from ....session.sources.folders import run_name
from ....session.state import State
from ....views.web.messages import message_of
from ....views.web.view_values import value_of, views
from ...lessons.lesson import OWN, Choose, Draw, Lesson, Number, Point, RunRequest, Step
from ...lessons.library import Library, built_in, own_lesson
from ...lessons.page_message import lesson_message
from ...lessons.reveal import Revealed, pictured, revealed
from ...lessons.state import Learning, Lessons
from ..data import data_files
from ..messages import branch_layer
from ..review import Review, reviewed
from ..site import packed
from .kept import KeptRun, Runs

LEFT_OUT = frozenset({"address", "hidden"})
"""Parts of the state that the page does not get while a question is open; it makes these by itself."""


@dataclass(frozen=True, eq=False)
class Part:
    """The steps of a lesson that are about one run."""

    own: RunRequest
    places: tuple[int, ...]
    """Of the steps."""
    others: tuple[tuple[str, RunRequest], ...]
    """Their further runs, by name: branches of it in this order."""


def parts_of(lesson: Lesson) -> list[Part]:
    """In the order in which the lesson comes to them."""
    found: list[Part] = []
    for own in _once(step.own for step in lesson.steps):
        places = tuple(i for i, step in enumerate(lesson.steps) if step.own == own)
        others = _once(pair for i in places for pair in lesson.steps[i].runs.items())
        found.append(Part(own, places, tuple(others)))
    return found


def _once(values: Iterable[Any]) -> list[Any]:
    """Settings cannot be hashed."""
    found: list[Any] = []
    for value in values:
        if value not in found:
            found.append(value)
    return found


def ends_of(lessons: Iterable[Lesson]) -> frozenset[int]:
    """The frames before the end at which a step wants to have its runs."""
    return frozenset(step.to for lesson in lessons for step in lesson.steps if step.to is not None)


def lessons_named(named: Iterable[str]) -> list[Lesson]:
    """Lessons by their names, or from Markdown files; all that come with ISPOM where none is named. InputError for an
    unknown one."""
    found = [own_lesson(name) or Library().lesson(name) for name in named]
    return found or list(built_in())


def lessons_data(lessons: list[Lesson], builder: Builder, most_bytes: float) -> dict[str, bytes]:
    """Returns the files of the lessons by name, with at most `most_bytes` together. Prints which lesson is being made.
    InputError as `ispom run`."""
    listed = [_listed(lesson) for lesson in lessons]
    found = {"site.bin": packed({"first": f"{lessons[0].name}-1", "listed": listed})}
    with TemporaryDirectory() as place:
        runs = Runs(Path(place), ends_of(lessons), builder)
        for lesson in lessons:
            _require(lesson, runs)
        for number, lesson in enumerate(lessons, 1):
            sys.stderr.write(f"{number} of {len(lessons)}: {printable(lesson.title)}\n")
            for step in lesson.steps:
                _runs_of(step, runs)
        images = sum(runs.of(part.own).kept.images for lesson in lessons for part in parts_of(lesson))
        for lesson in lessons:
            found |= lesson_files(lesson, runs, most_bytes / images)
    return found


def _require(lesson: Lesson, runs: Runs) -> None:
    """Raises InputError, which names the lesson, where one of its runs cannot be made."""
    for request in _once(request for step in lesson.steps for request in (step.own, *step.runs.values())):
        try:
            runs.require(request)
        except InputError as error:
            raise InputError(f"lesson {lesson.name}: {error}") from None


def lesson_files(lesson: Lesson, runs: Runs, image_bytes: float) -> Iterator[tuple[str, bytes]]:
    """Yields the names and contents of the files of a lesson. The files of each run take at most `image_bytes` for each
    of its images, including all that is said of it."""
    steps: dict[int, dict[str, Any]] = {}
    for number, part in enumerate(parts_of(lesson), 1):
        name = f"{lesson.name}-{number}"
        folders = [runs.of(request).folder for request in (part.own, *(request for _, request in part.others))]
        names = [run_name(part.own.source), *(other for other, _ in part.others)]
        with reviewed(folders, names, compares=False) as review:
            found, _ = data_files(review, folders, image_bytes * runs.of(part.own).kept.images)
            yield from ((f"{name}/{file}", content) for file, content in found.items())
            for place in part.places:
                steps[place] = {"run": name} | _step(lesson, place, part, runs, review)
    yield f"lesson-{lesson.name}.bin", packed({"steps": [steps[place] for place in range(len(lesson.steps))]})


def _listed(lesson: Lesson) -> dict[str, Any]:
    """As the page lists a lesson."""
    return {"name": lesson.name, "title": lesson.title, "minutes": lesson.minutes, "steps": len(lesson.steps)}


def _step(lesson: Lesson, place: int, part: Part, runs: Runs, review: Review) -> dict[str, Any]:
    step = lesson.steps[place]
    own, sequence = runs.of(step.own), runs.of(step.own).kept.ran(None).sequence
    seen = pictured(own.kept.ran(None).records, step.at, step.ask.camera) if isinstance(step.ask, Point) else None
    asking = Learning(lesson, place, "asking", None, seen)
    found = revealed(step, _runs_of(step, runs))
    told = replace(asking, phase="revealed", revealed=found)
    branches = [branch_layer(i) for i, other in enumerate(part.others, 1) if other in step.runs.items()]
    return {
        "at": step.at,
        "to": step.to,
        "hidden": sorted(step.hidden),
        "branches": branches,
        "asking": lesson_message(asking, sequence),
        "covered": _covered(review, asking) if asking.covers else None,
        "revealed": lesson_message(told, sequence),
        "within": _within(step, found),
    }


def _runs_of(step: Step, runs: Runs) -> Mapping[str, Any]:
    asked: dict[str, RunRequest] = {OWN: step.own, **step.runs}
    made: dict[str, KeptRun] = {name: runs.of(request) for name, request in asked.items()}
    return {name: run.kept.ran(step.to) for name, run in made.items()}


def _covered(review: Review, asking: Learning) -> dict[str, Any]:
    """What the page shows otherwise while the question is open, with the values of its views."""
    run, at = review.session.run, asking.step.at
    assert run is not None
    shown = replace(review.state, displayed=run.history[at])
    hidden = shown.having(Lessons(asking))
    own, covered = message_of(shown), message_of(hidden)
    differs = {key: value for key, value in covered.items() if key not in LEFT_OUT and value != own[key]}
    return {"message": differs, "views": _views(hidden, review)}


def _views(state: State, review: Review) -> dict[str, Any]:
    return {view.name: value_of(view, state, review.session.run) for view in views()}


def _within(step: Step, found: Revealed) -> float:
    """How near an answer has to be that is a number or a curve."""
    match step.ask:
        case Choose() | Point():
            return 0.0
        case Number():
            return step.ask.tolerance(found.values[step.ask.value])
        case Draw():
            return step.ask.within
