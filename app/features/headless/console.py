"""What a command without a page shows on a terminal."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from ispom.stop import LOOK_S, check_stop

from ...engine import warmup

Progress = Callable[[int | None], AbstractContextManager[Callable[[], None]]]
"""Of so many frames (None: nobody knows): gives a function to call after each."""


def wait_for_compiler() -> None:
    """Waits for numba's first compilation, and says so on a terminal."""
    if not warmup.finished():
        with Console(stderr=True).status(warmup.message()) as status:
            while not warmup.finished(LOOK_S):
                check_stop()
                status.update(warmup.message())


@contextmanager
def progress(total: int | None, quiet: bool = False) -> Iterator[Callable[[], None]]:
    """Gives a function to call after each frame; shows how far and how fast, on a terminal only, unless `quiet`.

    The function raises what ends the command, as `check_stop`.
    """
    columns = (
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]:.1f} frames/s,"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Bar(*columns, TextColumn("left"), console=console, disable=quiet or not console.is_terminal) as bar:
        task, start, count = bar.add_task("", total=total, rate=0.0), time.monotonic(), 0

        def advance() -> None:
            nonlocal count
            count += 1
            bar.update(task, advance=1, rate=count / max(time.monotonic() - start, 1e-9))
            check_stop()

        yield advance


silent: Progress = partial(progress, quiet=True)
