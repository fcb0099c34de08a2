"""Begins a sweep, follows it, and finds the runs that it made. Used in the worker's thread alone."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

from ispom.errors import InputError
from ispom.sequences.address import is_address, is_device

from ...engine.options import SourceOptions
from ...engine.run_folder.run_file import read_run_file
from ...session.current_run import CurrentRun
from ...session.review.origin import source_of, source_options
from ...session.store import Store
from .commands import RunSweep
from .plan import plan_text
from .process import SweepProcess
from .sweep import Sweep, workers
from .values import parsed, shown

CANCELLED = "cancelled"


class SweepDesk:
    """One sweep at a time; `recordings` is the folder in which each gets its own."""

    def __init__(self, store: Store, recordings: Path) -> None:
        self._store, self._recordings = store, recordings
        self._process: SweepProcess | None = None
        self._cancelled = False

    @property
    def busy(self) -> bool:
        return self._process is not None

    def begin(self, asked: RunSweep, run: CurrentRun | None) -> None:
        """Over the source of the run that is shown, with its settings but the one. InputError where that cannot be."""
        if self._process is not None:
            raise InputError("a sweep runs already: cancel it first")
        source, options = self._origin(run)
        swept = parsed(asked.method, asked.setting, asked.values)
        text = plan_text(swept, source, options, self._store.state.config)
        name = self._free()
        self._process = SweepProcess(text, self._recordings / name, workers(len(swept.values)))
        self._cancelled = False
        self._store.set(sweep=Sweep.begun(name, swept, source, options, time.monotonic()))

    def cancel(self) -> None:
        if self._process is not None:
            self._cancelled = True
            self._process.cancel()

    def watch(self) -> bool:
        """Takes what the process told; whether it has just ended."""
        process, sweep = self._process, self._store.state.sweep
        if process is None or sweep is None:
            return False
        over = not process.running  # before it is asked what it told: what it told last is not missed
        now_s = time.monotonic()
        for told in process.told():
            sweep = sweep.after(told, now_s)
        if over:
            self._process = None
            failure = process.failure
            # After the last run there was nothing left to cancel.
            cancelled = self._cancelled and (failure or len(sweep.outcomes) < len(sweep.swept.values))
            problem = CANCELLED if cancelled else sweep.problem or (failure and f"the sweep {failure}")
            process.stop()
            sweep = replace(sweep, ended=True, problem=problem, under_way={}, left_s=None)
        if sweep is not self._store.state.sweep:
            self._store.set(sweep=sweep)
        return over

    def folder(self, place: int, run: CurrentRun | None) -> tuple[Path, str, str]:
        """Of the run of a value: its folder, what it is called as a branch, and what it differs in.

        InputError where there is none, or another source is shown.
        """
        sweep = self._store.state.sweep
        outcome = sweep.outcomes.get(place) if sweep is not None else None
        if sweep is None or outcome is None or outcome.failure is not None:
            raise InputError("this value has no run that came to its end: choose another one")
        if self._origin(run) != (sweep.source, sweep.options):
            raise InputError(f"the sweep is over {sweep.source} as it was opened then: open that source first")
        value = f"{sweep.swept.setting.replace('_', '-')} {shown(outcome.value)}"
        changed = f"{sweep.swept.method} alone, {value}"
        return self._recordings / sweep.name / outcome.folder, f"{value}, {sweep.name}", changed

    def close(self) -> None:
        if self._process is not None:
            self._process.stop()

    def _origin(self, run: CurrentRun | None) -> tuple[str, SourceOptions]:
        """The source of the run that is shown, and how it was opened."""
        state = self._store.state
        if run is None:
            raise InputError("there is no run yet: open a source first")
        if run.live or is_device(state.source) or is_address(state.source):
            raise InputError("a live source cannot be run again by a sweep: film it, and open the film")
        run.require_source()
        if run.stored is None:
            return state.source, state.source_options
        written = read_run_file(run.stored.path)
        return source_of(written), source_options(written)

    def _free(self) -> str:
        """A name that nothing in the folder has."""
        return next(name for n in range(1, 100_000) if not (self._recordings / (name := f"sweep-{n}")).exists())
