"""Begins a sweep, follows it, and finds the runs that it made. Used in the worker's thread alone."""

from __future__ import annotations

import time
from dataclasses import replace

from ispom.errors import InputError
from ispom.sequences.address import is_address, is_device

from ...engine.options import SourceOptions
from ...engine.run_folder.run_file import read_run_file
from ...session.branches.service import BranchService
from ...session.branches.state import Branches
from ...session.controller import Controller
from ...session.current_run import CurrentRun
from ...session.review.stored import stored_source
from ...session.service import Service
from ...session.sources.opening import stored_at
from ..recording.service import RecordingService
from .process import SweepProcess
from .sweep import Sweep, SweepState, workers
from .values import parsed, plan_text, shown

CANCELLED = "cancelled"


class SweepService(Service):
    """One sweep at a time; each gets a folder of its own among the recordings."""

    place = 60

    def __init__(self, session: Controller) -> None:
        super().__init__(session)
        self._process: SweepProcess | None = None
        self._cancelled = False

    @property
    def busy(self) -> bool:
        return self._process is not None

    def start(self, method: str, setting: str, values: str) -> None:
        """Over the source of the run that is shown, with its settings but the one. InputError where that cannot be."""
        if self._process is not None:
            raise InputError("a sweep runs already: cancel it first")
        source, options = self._origin()
        swept = parsed(method, setting, values)
        text = plan_text(swept, source, options, self.state.config)
        name = self._free()
        self._process = SweepProcess(text, self.session.setup.recordings / name, workers(len(swept.values)))
        self._cancelled = False
        self.store.put(SweepState(Sweep.begun(name, swept, source, options, time.monotonic())))

    def cancel(self) -> None:
        if self._process is not None:
            self._cancelled = True
            self._process.cancel()

    def watch(self) -> None:
        """Takes the messages of the process."""
        process, sweep = self._process, self.state[SweepState].sweep
        if process is None or sweep is None:
            return
        over = not process.running  # before its messages are read, so that the last ones are not missed
        now_s = time.monotonic()
        for message in process.take_messages():
            sweep = sweep.after(message, now_s)
        if over:
            self._process = None
            failure = process.failure
            # After the last run there was nothing left to cancel.
            cancelled = self._cancelled and (failure or len(sweep.outcomes) < len(sweep.swept.values))
            problem = CANCELLED if cancelled else sweep.problem or (failure and f"the sweep {failure}")
            process.stop()
            sweep = replace(sweep, ended=True, problem=problem, under_way={}, left_s=None)
        if sweep is not self.state[SweepState].sweep:
            self.store.put(SweepState(sweep))
        if over:
            self.session.service(RecordingService).show()

    def show(self, place: int) -> None:
        """The run of a value, as it was computed, as a branch; one that is a branch already is shown again.

        InputError if there is none, or another source is shown.
        """
        sweep = self.state[SweepState].sweep
        outcome = sweep.outcomes.get(place) if sweep is not None else None
        if sweep is None or outcome is None or outcome.failure is not None:
            raise InputError("this value has no run that came to its end: choose another one")
        if self._origin() != (sweep.source, sweep.options):
            raise InputError(f"the sweep is over {sweep.source} as it was opened then: open that source first")
        value = f"{sweep.swept.setting.replace('_', '-')} {shown(outcome.value)}"
        name, branches = f"{value}, {sweep.name}", self.session.service(BranchService)
        known = next((b.number for b in self.state[Branches].all if b.name == name), None)
        if known is not None:
            branches.show(known)
            return
        path = self.session.setup.recordings / sweep.name / outcome.folder
        stored = stored_at(str(path), self.session.setup.opener, self.session.setup.builder)  # this program wrote it
        if stored is None:
            raise InputError(f"{path} holds no run any more: run the sweep again")
        found = CurrentRun.of_stored(stored, self.session.setup.history_bytes)
        branches.add(found, name, 0, (f"{sweep.swept.method} alone, {value}",), reproducible=True)

    def close(self) -> None:
        if self._process is not None:
            self._process.stop()

    def _origin(self) -> tuple[str, SourceOptions]:
        """The source of the run that is shown, and how it was opened."""
        state, run = self.state, self.run
        if run is None:
            raise InputError("there is no run yet: open a source first")
        if run.live or is_device(state.source) or is_address(state.source):
            raise InputError("a live source cannot be run again by a sweep: film it, and open the film")
        run.require_source()
        if run.stored is None:
            return state.source, state.source_options
        written = read_run_file(run.stored.path)
        found = stored_source(run.stored.path, written, None, self.session.screen.opener.asked_for)
        if found.places is not None:
            raise InputError("the run was made on another machine: run its source again, then sweep that run")
        return found.source, found.options

    def _free(self) -> str:
        """A name that nothing in the folder has."""
        return next(
            name for n in range(1, 100_000) if not (self.session.setup.recordings / (name := f"sweep-{n}")).exists()
        )
