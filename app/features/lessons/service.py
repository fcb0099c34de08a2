"""Leads through a lesson: sets the page for each step, and reveals its answer by running. In the worker's thread."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

from ispom.errors import InputError

from ...session import commands as do
from ...session.branches.service import BranchService
from ...session.branches.state import Branches
from ...session.controller import Controller
from ...session.current_run import CurrentRun
from ...session.service import Service
from ..layers.commands import ColourBy
from ..layers.state import Layers
from ..plots.commands import Plots
from ..tracks.commands import Inspection, LookAt, Pick, Select
from .lesson import OWN, Lesson, Point, RunRequest
from .library import Library
from .ran import Ran
from .reveal import pictured, revealed
from .state import Learning, Lessons

Job = Callable[[], None]
"""A part of the way; what it has computed is waited for before the next one."""


class LessonService(Service):
    place = 5

    def __init__(self, session: Controller) -> None:
        super().__init__(session)
        self.library = session.extra(Library)
        self._jobs: deque[Job] = deque()
        self._runs: dict[str, CurrentRun] = {}
        self._own_request: RunRequest | None = None
        """The request that the step's own run was made from."""
        self.store.put(Lessons(progress=self.library.progress.steps))

    @property
    def _now(self) -> Learning | None:
        return self.state[Lessons].now

    def enter(self, name: str, place: int | None) -> None:
        """Begins a lesson, or goes on with it. InputError for an unknown lesson or step."""
        self._enter(self.library.lesson(name), self._place_in(name, place))

    def turn_to(self, place: int) -> None:
        """Another step of the lesson that is on. InputError for an unknown one."""
        if self._now is not None:
            self._enter(self._now.lesson, place)

    def reveal(self) -> None:
        """Runs what the open question is about."""
        now = self._now
        if now is not None and now.phase == "asking":
            self._set(replace(now, phase="running"))
            self._jobs.extend(self._revealing(now))

    def end(self) -> None:
        """Back to the page as it is without a lesson."""
        self._jobs.clear()
        self._obey(do.Play(False))
        self._set(None)
        self._show_all()

    def check(self, command: do.Command) -> None:
        """InputError for what would answer an open question, or disturb the run that does."""
        learning, state = self._now, self.state
        if learning is None or not learning.open or command.in_lessons:
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
                case do.GoToEnd() | Select() | Pick() | ColourBy() | LookAt():
                    return
        raise InputError("a question of the lesson is open: answer it and reveal the answer, or end the lesson first")

    def opens_a_run(self, name: str | None, place: int | None) -> bool:
        """Whether a step of a lesson (None: of the one that is on) begins with another run than the one that is shown.

        InputError for an unknown lesson.
        """
        if name is not None:
            lesson, place = self.library.lesson(name), self._place_in(name, place)
        elif self._now is not None and place is not None:
            lesson = self._now.lesson
        else:
            return False
        return 0 <= place < len(lesson.steps) and not self._is_shown(lesson.steps[place].own)

    def watch(self) -> None:
        """The next part of the way, where the one before is done."""
        if self._jobs and self.state.target is None:
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
    def impatient(self) -> bool:
        return bool(self._jobs)

    def _place_in(self, name: str, place: int | None) -> int:
        """The step to begin with."""
        if place is not None:
            return place
        lesson = self.library.lesson(name)
        done = self.library.progress.steps.get(lesson.name, 0)
        return done if done < len(lesson.steps) else 0

    def _set(self, learning: Learning | None) -> None:
        self.store.put(replace(self.state[Lessons], now=learning))

    def _show_all(self) -> None:
        self.store.put(replace(self.state[Layers], hidden=frozenset()))

    def _obey(self, command: do.Command) -> None:
        command.execute(self.session)

    def _enter(self, lesson: Lesson, place: int) -> None:
        if not 0 <= place < len(lesson.steps):
            raise InputError(f"{lesson.title} has {len(lesson.steps)} steps: there is no step {place + 1}")
        learning = Learning(lesson, place)
        self._obey(do.Play(False))
        self._set(learning)
        self.store.put(replace(self.state[Inspection], selected=""))
        self.store.put(Plots())
        self.store.put(replace(self.state[Layers], hidden=learning.step.hidden))
        self._jobs = deque(self._preparing(learning))

    def _give_up(self) -> None:
        """As before the question was revealed; a step that cannot be set up ends the lesson."""
        self._jobs.clear()
        learning = self._now
        if learning is not None:
            running = learning.phase == "running"
            self._set(replace(learning, phase="asking") if running else None)

    def _preparing(self, learning: Learning) -> Iterator[Job]:
        step = learning.step
        yield partial(self._show_own, step.own)
        yield partial(self._obey, do.Seek(step.at))
        yield partial(self._ask, learning)

    def _show_own(self, request: RunRequest) -> None:
        """Shows the run of the step: the shown one, where its request is the same."""
        shown = self.run
        if shown is None or not self._is_shown(request):
            shown = self.session.screen.computed_run(request.source, None, request.methods, request.config)
            self.session.screen.open_run(shown, request.source, keep=self._is_a_persons())
        self._own_request, self._runs = request, {OWN: shown}

    def _is_a_persons(self) -> bool:
        """Whether the run that is shown, or a fork of it, is not the lesson's own."""
        return self.run is not self._runs.get(OWN) or bool(self.session.service(BranchService).loss())

    def _is_shown(self, request: RunRequest) -> bool:
        shown = self.run
        return shown is not None and request == self._own_request and shown is self._runs.get(OWN)

    def _ask(self, learning: Learning) -> None:
        ask, at = learning.step.ask, learning.step.at
        seen = pictured(self._runs[OWN].history, at, ask.camera) if isinstance(ask, Point) else None
        self._set(replace(learning, phase="asking", pictured=seen))

    def _revealing(self, learning: Learning) -> Iterator[Job]:
        step, number = learning.step, self.state[Branches].shown
        yield partial(self._run_on, step.to)
        for name, request in step.runs.items():
            yield partial(self._add, name, request)
            yield partial(self._run_on, step.to)
        if step.runs:
            yield partial(self.session.service(BranchService).show, number)
        yield partial(self._reveal, learning)

    def _add(self, name: str, request: RunRequest) -> None:
        found = self.session.screen.computed_run(request.source, None, request.methods, request.config)
        self.session.service(BranchService).add(found, name, 0, (name,), reproducible=True)
        self._runs[name] = found

    def _run_on(self, to: int | None) -> None:
        """Up to this frame, or to the end."""
        run = self.run
        if run is not None:
            self._obey(do.Seek(run.last if to is None else to))

    def _reveal(self, learning: Learning) -> None:
        found = revealed(learning.step, {name: ran(run) for name, run in self._runs.items()})
        steps = self.library.progress.reached(learning.lesson.name, learning.place + 1)
        pictured = self._now and self._now.pictured
        self.store.put(Lessons(replace(learning, phase="revealed", revealed=found, pictured=pictured), steps))
        self._show_all()


def ran(run: CurrentRun) -> Ran:
    """A run as far as it is computed."""
    return Ran(run.opened, run.history, run.series, run.finish())
