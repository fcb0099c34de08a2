"""The session as tools see it: questions wait for their answers, and nothing is opened that was not allowed."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as Late
from pathlib import Path
from typing import Any, TypeVar

from ispom.errors import InputError
from ispom.io.files import exists, expanded, is_below
from ispom.sequences.address import without_secrets

from ...session import moves
from ...session.branches.service import BranchService
from ...session.branches.state import Branches
from ...session.commands import Command, Confirm, Open
from ...session.controller import Controller
from ...session.current_run import CurrentRun
from ...session.session import Session
from ...session.state import State
from ..recording.listing import list_recordings

T = TypeVar("T")
PATIENCE_S = 300.0
"""For one piece of work in the session's thread: opening a video may find its calibration first."""
LOOK_S = 0.02
"""Interval between two looks at the progress of a computation."""
SIMULATION = "sim:"


class Ask(Command, frozen=True):
    """Does something in the session's thread, and passes on what it returns or raises."""

    work: Any
    answer: Any
    """A Future."""

    def execute(self, session: Controller) -> None:
        try:
            self.answer.set_result(self.work(session))
        except Exception as fault:
            self.answer.set_exception(fault)


class AgentSession:
    """For any thread. What changes the session is done by its own thread, one thing at a time."""

    def __init__(
        self,
        session: Session,
        sources: tuple[str, ...] = (),
        runs: Path | None = None,
        *,
        poses: tuple[Path, ...] = (),
        allow_changes: bool = False,
        shared: bool = False,
    ) -> None:
        """`sources` may be opened, as may runs and recordings in the folder `runs`, and simulations. Files in these
        folders, and those in `poses`, may be read as poses. Unless `allow_changes`, tools that change anything are
        refused; where the session is `shared` with a person at a page, those that show something else are refused, too.
        """
        self.session, self.sources, self.runs = session, sources, runs or session.recordings_dir
        named = (expanded(source) for source in sources if not source.startswith(SIMULATION))
        self.places = (self.runs, *(path for path in named if os.path.exists(path)), *map(expanded, poses))
        """Files that may be read, and folders in which all may be."""
        self.allow_changes, self.shared = allow_changes, shared

    def require_changes(self, what: str) -> None:
        """InputError where nothing may be changed."""
        if not self.allow_changes:
            cure = "ask the person at the page" if self.shared else "start `ispom mcp` with --allow-changes"
            raise InputError(f"{what} changes the session, which is read-only: {cure}")

    def require_control(self, what: str) -> None:
        """InputError where a person controls what is shown."""
        if self.shared:
            raise InputError(f"{what} would show something else to the person at the page: ask them to do it")

    @property
    def state(self) -> State:
        return self.session.state

    @property
    def run(self) -> CurrentRun:
        """The run that is open; waits for one that is being opened. InputError where none is."""
        if self.session.run is None and self.state.phase == "opening":
            self.carry_out(lambda controller: None)
        run = self.session.run
        if run is None:
            raise InputError(self.state.failure or "no run is open: call list_runs, then open_run")
        return run

    def branch(self, number: int | None) -> CurrentRun:
        """A branch of the run, or the one that is shown for None. InputError for an unknown one."""
        if number is None:
            return self.run
        found = self.session.service(BranchService).run_of(number)
        if found is None:
            known = ", ".join(str(b.number) for b in self.state[Branches].all)
            raise InputError(f"there is no branch {number}: give one of {known or 'a run that is open'}")
        return found

    def frame(self, index: int) -> int:
        """The index, where the run has computed this frame; InputError else."""
        count = len(self.run.series)
        if not 0 <= index < count:
            known = f"frames 0 to {count - 1} are computed" if count else "no frame is computed"
            cure = "give one of these" if self.run.stored is not None else "call compute first"
            raise InputError(f"frame {index} is not there, {known}: {cure}")
        return index

    def stretch(self, first: int, last: int | None) -> range:
        """The computed frames from `first` to `last` (None: to the end), both included. InputError where there is
        none."""
        count = len(self.run.series)
        found = range(max(first, 0), count if last is None else min(last + 1, count))
        if not found:
            until = "the end" if last is None else last
            raise InputError(f"no frame from {first} to {until} is computed, {count} are: call compute, or give others")
        return found

    def method(self, name: str) -> str:
        """The name of a method of the run. InputError for another one."""
        known = self.run.opened.methods
        if name not in known:
            raise InputError(f"{name[:60]!r} does not run here: give one of {', '.join(known)}")
        return name

    def carry_out(self, work: Callable[[Controller], T], patience_s: float = PATIENCE_S) -> T:
        """What `work` returns in the session's thread. Raises what it raises; InputError where it takes too long."""
        answer: Future[T] = Future()
        self.session.post(Ask(work, answer))
        try:
            return answer.result(patience_s)
        except Late:
            raise InputError(f"the session was busy for more than {patience_s:.0f} s: ask again later") from None

    def open(self, source: str, *, discard: bool = False) -> None:
        """Opens a run or a source that is allowed, without playing it. InputError where it is not, or cannot be opened.

        `discard`: forks that nothing keeps may be closed with the run that is open.
        """
        path = self.place(source)
        if discard:
            self.require_changes("discard")

        def work(controller: Controller) -> None:
            before = controller.state.question
            controller.obey(Open(path))
            question = controller.state.question
            if question is not None and question is not before:
                controller.obey(Confirm(question.number, discard))
                if not discard:
                    raise InputError(f"{question.text} Or give discard=true")
            if controller.state.phase == "failed":
                raise InputError(controller.state.failure)
            controller.store.set(playing=False)

        self.carry_out(work)

    def place(self, source: str) -> str:
        """The address of a source that may be opened. InputError for any other one."""
        named = next((each for each in self.sources if source in (each, without_secrets(each))), None)
        if named is not None:
            return named
        if source.startswith(SIMULATION):
            return source
        if source in self.keys:
            return str(self.runs / source)
        raise InputError(f"{source[:80]!r} may not be opened here: give a key of list_runs, or {SIMULATION}NAME")

    def folder(self, key: str) -> Path:
        """The folder of a run that may be read. InputError for anything else."""
        place = self.place(key)
        path = Path(place).expanduser()
        if place.startswith(SIMULATION) or not path.is_dir():
            raise InputError(f"{key[:80]!r} is no folder of a run: give the key of one from list_runs")
        return path

    def file(self, name: str) -> Path:
        """The path of a file or folder that may be read: within the folder of runs, or by its whole path. InputError
        for any other one. It is to be read within `confined(places)`: a link in it may lead elsewhere."""
        for path in (self.runs / name, expanded(name)):
            bag = Path(str(path).partition(":/")[0])  # BAG:TOPIC
            if any(is_below(each, self.places) and exists(each) for each in (path, bag)):
                return path
        raise InputError(
            f"{name[:80]!r} may not be read here, or is missing: give a file in the folder of runs or in a folder that "
            "was named at the start"
        )

    @property
    def keys(self) -> frozenset[str]:
        """Those of the runs and recordings in the folder of runs."""
        return frozenset(each.name for each in list_recordings(self.runs))

    def compute(self, frame: int | None, seconds: float) -> None:
        """Computes the frames up to `frame` (None: the last), and waits for at most `seconds`; the rest is computed in
        the background. InputError where a frame cannot be computed."""
        run, notices = self.run, self.state.notice_count
        target = run.last if frame is None else min(frame, run.last)
        self.carry_out(lambda controller: controller.player.move(*moves.seek(controller.run, target)))
        until = time.monotonic() + seconds
        while self.state.target is not None and time.monotonic() < until:
            time.sleep(LOOK_S)
        if self.state.target is None and len(run.series) <= target and self.state.notice_count > notices:
            raise InputError(self.state.notices[-1].text)
