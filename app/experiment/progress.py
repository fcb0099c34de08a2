"""How far an experiment is, and how long it still takes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from .row import Row


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
