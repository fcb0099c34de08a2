"""The command: reads the plan, runs what is not done yet, writes what came out."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Protocol

import msgspec
import yaml
from rich.console import Console

from ispom.ensemble import build
from ispom.errors import InputError, counted, printable
from ispom.io.files import exists
from ispom.io.rows import read_text
from ispom.io.whole import write_whole

from ...engine import warmup
from ...engine.outputs import claim_folder
from ...engine.playback import Builder
from ...engine.run_folder.run_folder import locked
from ...engine.signals import terminable
from ..headless.console import Progress as OfRun
from ..headless.console import silent, wait_for_compiler
from .execute import execute, finished_before, missing
from .faults import FAULTS, faults
from .jobs import Jobs, part, shown, take_all, whole, workers_of
from .options import Experiment, Runs
from .page import PAGE, write_output
from .plan import Plan, Run, config_of
from .plan_file import read_plan
from .results import by_plan
from .row import Row
from .shards import MISSING, Shard, failures, report_text, retried, shard_of
from .statistics import Outcome

COMMAND, PLAN = "experiment", "plan.yaml"


def experiment(options: Experiment, builder: Builder = build) -> int:
    """Runs what is missing, writes tables, figures and the page, and prints what became of the statements.

    The exit code is 0, also where runs failed: those are rows that say why. InputError as `completed`.
    """
    if options.plan == FAULTS:
        return faults(options, builder)
    if options.fault or options.methods or options.doctor_only or options.table is not None:
        raise InputError(
            "--fault, --methods, --doctor-only and --table are of `ispom experiment faults`: leave them out"
        )
    plan = read_plan(options)
    if options.shard is not None:
        return _shard(options, plan, shard_of(options.shard), builder)
    rows, outcomes = completed(options, plan, builder, Terminal(), options.merge)
    failed = [row for row in rows if row.failure is not None]
    lines = [f"failed: {row.run}: {row.failure}" for row in by_plan(plan, failed)]
    lines += [f"{o.verdict}: {o.statement.text} ({_counts(o)})" for o in outcomes]
    if find_spec("matplotlib") is None:
        lines.append("no figures: run pip install 'ispom[plots]', and this command again")
    lines.append(f"{len(rows) - len(failed)} runs, {len(failed)} failed: {options.out / PAGE}")
    sys.stdout.write("\n".join(map(printable, lines)) + "\n")
    return 0


def _counts(outcome: Outcome) -> str:
    """Returns in how many runs it holds, how many say nothing, and how much was located."""
    untested = [f"{outcome.untested} not tested"] if outcome.untested else []
    coverage = [outcome.coverage] if outcome.statement.needs_coverage and outcome.coverage else []
    return ", ".join([f"{outcome.holding} of {outcome.runs}", *untested, *coverage])


def _shard(options: Experiment, plan: Plan, shard: Shard, builder: Builder) -> int:
    """Computes a part of the runs, and prints what failed."""
    if options.merge:
        raise InputError("--shard computes a part, --merge tables all parts: give one of them")
    workers = workers_of(options, 0)
    retried(lambda: _claim(options.out, plan))
    with part(options.out, shard) as report:
        return _part(options, plan, shard, report, workers, builder)


def _part(options: Experiment, plan: Plan, shard: Shard, report: Path, workers: int, builder: Builder) -> int:
    runs = shard.of(list(plan.runs()))
    before = [row for run in runs if (row := finished_before(plan, run, options.out)) is not None]
    done_before = {row.run for row in before}
    left, rows = [run for run in runs if run not in done_before], before
    _say_missing(plan, left)
    terminal, known = Terminal(), len(before)
    with terminable() as signals:
        _compile(left)
        done = _jobs(plan, left, options).computed(options, workers, _here(plan, options, builder, terminal))
        take_all(done, lambda found: terminal.rows(found, len(runs), known), rows.append, signals)
    rows = by_plan(plan, rows)
    write_whole(report, report_text(rows))
    failed = [row for row in rows if row.failure is not None]
    lines = [f"failed: {row.run}: {row.failure}" for row in failed]
    lines.append(f"shard {shard.number} of {shard.count}: {counted(len(rows), 'run')}, {len(failed)} failed: {report}")
    sys.stdout.write("\n".join(map(printable, lines)) + "\n")
    return 0


def _claim(out: Path, plan: Plan) -> None:
    """Makes the folder, with the plan in it; InputError where it holds anything else."""
    claim_folder(out, COMMAND)
    content = yaml.safe_dump(msgspec.to_builtins(plan), sort_keys=False, allow_unicode=True)
    if not exists(out / PLAN) or read_text(out / PLAN) != content:
        write_whole(out / PLAN, content)


def _say_missing(plan: Plan, runs: Sequence[Run]) -> None:
    """A sentence on standard error for each thing that runs will miss, before the first of them."""
    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    for sentence in missing(plan, runs):
        console.print(printable(f"missing: {sentence}"))


def _compile(runs: Iterable[Run]) -> None:
    """What the methods need, once and not in each worker."""
    for line in {run.line for run in runs}:
        warmup.start([line.method], config_of(line))
    wait_for_compiler()


def completed(
    options: Runs, plan: Plan, builder: Builder, watcher: Watcher, merge: bool = False
) -> tuple[Sequence[Row], Sequence[Outcome]]:
    """Every run of the plan, and what became of its statements; all is written. `merge`: nothing is computed.

    InputError for what is wrong with the plan, the folder or the cluster, and where another command writes into the
    folder. A signal ends it with what was computed so far written.
    """
    workers = workers_of(options)
    claim_folder(options.out, COMMAND)
    with locked(options.out) if merge else whole(options.out, ", or give --merge"):
        return _completed(options, plan, workers, builder, watcher, merge)


def _completed(
    options: Runs, plan: Plan, workers: int, builder: Builder, watcher: Watcher, merge: bool
) -> tuple[Sequence[Row], Sequence[Outcome]]:
    _claim(options.out, plan)
    runs = list(plan.runs())
    before = {run: row for run in runs if (row := finished_before(plan, run, options.out)) is not None}
    left, rows = [run for run in runs if run not in before], list(before.values())
    if merge:
        known = failures(options.out)
        rows += [Row(run, known.get(run.folder.as_posix(), MISSING)) for run in left]
        left = []
    _say_missing(plan, left)
    outcomes: Sequence[Outcome] = ()
    with terminable() as signals:
        _compile(left)
        try:
            done = _jobs(plan, left, options).computed(options, workers, _here(plan, options, builder, watcher))
            take_all(done, lambda found: watcher.rows(found, len(runs), len(before)), rows.append, signals)
        finally:
            signals.hold()
            outcomes = write_output(options.out, plan, by_plan(plan, rows))
    return rows, outcomes


def _jobs(plan: Plan, left: Sequence[Run], options: Runs) -> Jobs[Plan, Run, Row]:
    return Jobs(plan, left, options.out, execute, Row, options.recordings)


def _here(plan: Plan, options: Runs, builder: Builder, watcher: Watcher) -> Callable[[Run], Row]:
    """What computes a run in this process."""
    return lambda run: execute(plan, run, options.out, options.recordings, builder, watcher.of_run(run))


class Watcher(Protocol):
    """Receives the progress of an experiment."""

    def rows(self, rows: Iterable[Row], total: int, before: int) -> Iterator[Row]:
        """The same rows, of which `before` were known already."""
        ...

    def of_run(self, run: Run) -> OfRun:
        """Receives the progress of a run that is computed in this process."""
        ...


class Terminal:
    """A line for each run."""

    def rows(self, rows: Iterable[Row], total: int, before: int) -> Iterator[Row]:
        return shown(rows, total, before)

    def of_run(self, run: Run) -> OfRun:
        return silent
