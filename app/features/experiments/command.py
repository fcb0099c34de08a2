"""The command: reads the plan, runs what is not done yet, writes what came out."""

from __future__ import annotations

import os
import sys
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path
from typing import Protocol, TypeVar

import msgspec
import yaml
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from ispom.ensemble import build
from ispom.errors import InputError, counted, printable
from ispom.io.files import exists
from ispom.io.rows import read_text
from ispom.io.whole import require_no_links, write_whole

from ...engine import warmup
from ...engine.outputs import claim_folder
from ...engine.playback import Builder
from ...engine.run_folder.run_folder import locked
from ...engine.signals import terminable
from ..headless.console import Progress as OfRun
from ..headless.console import silent, wait_for_compiler
from . import cluster
from .execute import execute_in_order, finished_before, missing
from .faults import FAULTS, faults
from .options import Experiment, Parallel, Runs
from .page import PAGE, write_output
from .plan import Plan, Run, config_of
from .plan_file import read_plan
from .results import by_plan
from .row import Row
from .shards import MISSING, Shard, failures, report_text, retried, running, shard_of
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
    report = options.out / shard.file
    report.parent.mkdir(exist_ok=True)
    require_no_links(options.out, report)
    with locked(report):
        return _part(options, plan, shard, report, workers, builder)


def _part(options: Experiment, plan: Plan, shard: Shard, report: Path, workers: int, builder: Builder) -> int:
    runs = shard.of(list(plan.runs()))
    before = [row for run in runs if (row := finished_before(plan, run, options.out)) is not None]
    done_before = {row.run for row in before}
    left, rows = [run for run in runs if run not in done_before], before
    _say_missing(plan, left)
    with terminable() as signals:
        _compile(left)
        with closing(_scheduled(plan, left, options, workers, builder, Terminal())) as done:
            for row in shown(done, len(runs), len(before)):
                rows.append(row)
                signals.check()
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
    with locked(options.out):
        if not merge and (part := running(options.out)) is not None:
            raise InputError(f"{options.out}: shard {part} is being computed: wait for its end, or give --merge")
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
            with closing(_scheduled(plan, left, options, workers, builder, watcher)) as done:
                for row in watcher.rows(done, len(runs), len(before)):
                    rows.append(row)
                    signals.check()
        finally:
            signals.hold()
            outcomes = write_output(options.out, plan, by_plan(plan, rows))
    return rows, outcomes


def workers_of(options: Parallel, default: int | None = None) -> int:
    """0: in this process. Without a `default`, one for each core where Dask is installed."""
    if options.workers is not None and not 0 <= options.workers <= 1024:
        raise InputError(f"--workers is {options.workers}, give a value from 0 to 1024")
    if not 0.5 <= options.memory_gb <= 4096:
        raise InputError(f"--memory-gb is {options.memory_gb:g}, give a value from 0.5 to 4096")
    if options.workers is not None:
        return options.workers
    if default is not None:
        return default
    return (os.cpu_count() or 1) if cluster.installed() else 0


def _scheduled(
    plan: Plan, runs: Sequence[Run], options: Runs, workers: int, builder: Builder, watcher: Watcher
) -> Generator[Row, None, None]:
    if not runs or (options.scheduler is None and workers == 0):
        return execute_in_order(plan, runs, options.out, options.recordings, builder, watcher.of_run)
    return cluster.rows(plan, runs, options.out, options.recordings, workers, options.memory_gb, options.scheduler)


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


class Ended(Protocol):
    """What is said of a run that is over."""

    @property
    def run(self) -> object: ...

    @property
    def failure(self) -> str | None: ...


E = TypeVar("E", bound=Ended)


def shown(rows: Iterable[E], total: int, before: int) -> Iterator[E]:
    """The same rows; on standard error a line for each, and on a terminal a bar below them with the time left."""
    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    if before:
        console.print(f"{before} of {total} runs were done before")
    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("runs,"), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, TextColumn("left"), console=console, disable=not console.is_terminal) as bar:
        task, done = bar.add_task("", total=total - before), before
        for row in rows:
            done += 1
            bar.update(task, advance=1)
            console.print(f"[{done}/{total}] {row.run}{'' if row.failure is None else f': failed: {row.failure}'}")
            yield row
