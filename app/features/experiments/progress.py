"""How far an experiment is, and how long it still takes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from ..headless.console import Progress as OfRun
from ..headless.console import silent
from .plan import Run
from .row import Row


class Watcher(Protocol):
    """Who is told how far an experiment is."""

    def rows(self, rows: Iterable[Row], total: int, before: int) -> Iterator[Row]:
        """The same rows, of which `before` were known already."""
        ...

    def of_run(self, run: Run) -> OfRun:
        """Who is told of the exposures of a run, where it is computed in this process."""
        ...


class Terminal:
    """A line for each run."""

    def rows(self, rows: Iterable[Row], total: int, before: int) -> Iterator[Row]:
        return shown(rows, total, before)

    def of_run(self, run: Run) -> OfRun:
        return silent


def shown(rows: Iterable[Row], total: int, before: int) -> Iterator[Row]:
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
