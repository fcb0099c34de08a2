"""The engine of the commands that compute many jobs: the runs of a plan for `experiment`, `gate` and the page's sweep,
and the clips of a folder for `triage`. Those that are in the folder already are not computed again; the others are one
after the other in this process, or several at a time by Dask, and all of them, or the part of an array job.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from ispom.errors import InputError
from ispom.io.whole import require_no_links

from ...engine.run_folder.run_folder import locked
from ...engine.signals import Signals
from . import cluster
from .cluster import Piece
from .options import Parallel
from .shards import Shard, running

P = TypeVar("P")
T = TypeVar("T", bound=Piece)
D = TypeVar("D")


@dataclass(frozen=True)
class Jobs(Generic[P, T, D]):
    """What a command computes, and where."""

    order: P
    """What holds for all of them, such as the plan."""
    left: Sequence[T]
    out: Path
    """Folder in which each job has one of its own."""
    task: Callable[[P, T, Path, bool], D]
    """Computes one: a function of a module, for it is sent to workers. What goes wrong is in what it gives."""
    failed: Callable[[T, str], D]
    """Makes the same of one that no worker could compute, and a sentence that says why."""
    recording: bool = False

    def computed(self, where: Parallel, workers: int, here: Callable[[T], D]) -> Generator[D, None, None]:
        """What each gives, as they are completed; `here` computes one in this process. InputError where the cluster
        does not answer."""
        if not self.left or (where.scheduler is None and workers == 0):
            return (here(job) for job in self.left)
        return cluster.parallel(
            self.order,
            self.left,
            self.out,
            self.recording,
            workers,
            where.memory_gb,
            where.scheduler,
            self.task,
            self.failed,
        )


def take_all(
    done: Generator[D, None, None],
    watched: Callable[[Iterable[D]], Iterator[D]],
    take: Callable[[D], object],
    signals: Signals,
) -> None:
    """Takes what jobs give, as `watched` passes it on. A signal ends it between two, and the workers with it."""
    with closing(done):
        for each in watched(done):
            take(each)
            signals.check()


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


@contextmanager
def whole(out: Path, instead: str = "") -> Iterator[None]:
    """Keeps the folder for a command that computes all jobs, or tables them. InputError where another one writes to
    it, or computes a part: that is waited for, or else `instead` is done."""
    with locked(out):
        if (part := running(out)) is not None:
            raise InputError(f"{out}: shard {part} is being computed: wait for its end{instead}")
        yield


@contextmanager
def part(out: Path, shard: Shard) -> Iterator[Path]:
    """Keeps the report of a part, whose file this gives, for the command that computes it. InputError where another
    one does."""
    report = out / shard.file
    report.parent.mkdir(exist_ok=True)
    require_no_links(out, report)
    with locked(report):
        yield report


class Ended(Protocol):
    """What is said of a job that is over."""

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
