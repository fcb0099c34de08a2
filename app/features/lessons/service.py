"""Leads through a lesson: sets the page for each step, and reveals its answer by running. In the worker's thread."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

from ispom.errors import InputError

from ...session import commands as do
from ...session.current_run import CurrentRun
from ...session.store import Store
from ..plots.plotting import DEFAULT_PLOTS
from .commands import EndLesson, Learn, OfLessons, Reveal, TurnTo
from .learning import Learning
from .lesson import OWN, Asked, Lesson, Point
from .library import Library
from .ran import Ran
from .reveal import pictured, revealed

Job = Callable[[], None]
"""A part of the way; what it has computed is waited for before the next one."""


class LessonDesk:
    """`command` does what a person could ask; `open_run` and `add_run` give the run that is shown from then on."""

    def __init__(
        self,
        store: Store,
        library: Library,
        command: Callable[[do.Command], None],
        open_run: Callable[[Asked], CurrentRun],
        add_run: Callable[[Asked, str], CurrentRun],
        shown: Callable[[], CurrentRun | None],
    ) -> None:
        self._store, self._library, self._command = store, library, command
        self._open_run, self._add_run, self._shown = open_run, add_run, shown
        self._jobs: deque[Job] = deque()
        self._runs: dict[str, CurrentRun] = {}
        self._asked: Asked | None = None
        """What the step's own run was asked as."""

    def obey(self, command: OfLessons) -> None:
        """InputError where it cannot be done now."""
        learning = self._store.state.lesson
        match command:
            case Learn(name):
                self._enter(self._library.lesson(name), self._place_in(command))
            case EndLesson():
                self._end()
            case TurnTo(place) if learning is not None:
                self._enter(learning.lesson, place)
            case Reveal() if learning is not None and learning.phase == "asking":
                self._store.set(lesson=replace(learning, phase="running"))
                self._jobs.extend(self._revealing(learning))

    def require_allowed(self, command: do.Command) -> None:
        """InputError for what would answer an open question, or disturb the run that does."""
        learning, state = self._store.state.lesson, self._store.state
        if learning is None or not learning.open or isinstance(command, OfLessons | do.Notify | do.Shutdown):
            return
        if learning.phase == "asking":
            last = state.computed - 1
            match command:
                case do.Seek(index) if index <= last:
                    return
                case do.StepBy(count) if state.index + count <= last:
                    return
                case do.StepTo(_, forwards) if not forwards:
                    return
                case do.GoToEnd() | do.Select() | do.Pick() | do.ColourBy() | do.LookAt():
                    return
        raise InputError("a question of the lesson is open: answer it and reveal the answer, or end the lesson first")

    def opens_a_run(self, command: Learn | TurnTo) -> bool:
        """Whether the step that is asked for begins with another run than the one that is shown.

        InputError for an unknown lesson.
        """
        learning = self._store.state.lesson
        if isinstance(command, Learn):
            lesson, place = self._library.lesson(command.name), self._place_in(command)
        elif learning is not None:
            lesson, place = learning.lesson, command.place
        else:
            return False
        return 0 <= place < len(lesson.steps) and not self._is_shown(lesson.steps[place].own)

    def turn(self) -> None:
        """The next part of the way, where the one before is done."""
        if self._jobs and self._store.state.target is None:
            job = self._jobs.popleft()
            try:
                job()
            except Exception:
                self._give_up()
                raise

    def failed(self) -> None:
        """A run that was under way failed."""
        if self._jobs:
            self._give_up()

    @property
    def busy(self) -> bool:
        return bool(self._jobs)

    def _place_in(self, command: Learn) -> int:
        """The step to begin with."""
        if command.place is not None:
            return command.place
        lesson = self._library.lesson(command.name)
        done = self._library.progress.steps.get(lesson.name, 0)
        return done if done < len(lesson.steps) else 0

    def _enter(self, lesson: Lesson, place: int) -> None:
        if not 0 <= place < len(lesson.steps):
            raise InputError(f"{lesson.title} has {len(lesson.steps)} steps: there is no step {place + 1}")
        learning = Learning(lesson, place)
        self._command(do.Play(False))
        self._store.set(lesson=learning, selected="", plots=DEFAULT_PLOTS, hidden=learning.step.hidden)
        self._jobs = deque(self._preparing(learning))

    def _end(self) -> None:
        self._jobs.clear()
        self._command(do.Play(False))
        self._store.set(lesson=None, hidden=frozenset())

    def _give_up(self) -> None:
        """As before the question was revealed; a step that cannot be set up ends the lesson."""
        self._jobs.clear()
        learning = self._store.state.lesson
        if learning is not None:
            running = learning.phase == "running"
            self._store.set(lesson=replace(learning, phase="asking") if running else None)

    def _preparing(self, learning: Learning) -> Iterator[Job]:
        step = learning.step
        yield partial(self._show_own, step.own)
        yield partial(self._command, do.Seek(step.at))
        yield partial(self._ask, learning)

    def _show_own(self, asked: Asked) -> None:
        """The run of the step: the one that is shown, where it was asked in the same words."""
        shown = self._shown()
        if shown is None or not self._is_shown(asked):
            shown = self._open_run(asked)
        self._asked, self._runs = asked, {OWN: shown}

    def _is_shown(self, asked: Asked) -> bool:
        shown = self._shown()
        return shown is not None and asked == self._asked and shown is self._runs.get(OWN)

    def _ask(self, learning: Learning) -> None:
        ask, at = learning.step.ask, learning.step.at
        seen = pictured(self._runs[OWN].history, at, ask.camera) if isinstance(ask, Point) else None
        self._store.set(lesson=replace(learning, phase="asking", pictured=seen))

    def _revealing(self, learning: Learning) -> Iterator[Job]:
        step, number = learning.step, self._store.state.branch
        yield partial(self._run_on, step.to)
        for name, asked in step.runs.items():
            yield partial(self._add, name, asked)
            yield partial(self._run_on, step.to)
        if step.runs:
            yield partial(self._command, do.ShowBranch(number))
        yield partial(self._reveal, learning)

    def _add(self, name: str, asked: Asked) -> None:
        self._runs[name] = self._add_run(asked, name)

    def _run_on(self, to: int | None) -> None:
        """Up to this exposure, or to the end."""
        run = self._shown()
        if run is not None:
            self._command(do.Seek(run.last if to is None else to))

    def _reveal(self, learning: Learning) -> None:
        found = revealed(learning.step, {name: ran(run) for name, run in self._runs.items()})
        steps = self._library.progress.reached(learning.lesson.name, learning.place + 1)
        pictured = self._store.state.lesson and self._store.state.lesson.pictured
        after = replace(learning, phase="revealed", revealed=found, pictured=pictured)
        self._store.set(lesson=after, progress=steps, hidden=frozenset())


def ran(run: CurrentRun) -> Ran:
    """A run as far as it is computed."""
    return Ran(run.opened, run.history, run.series, run.finish())
