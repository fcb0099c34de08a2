"""What a command without a page shows on a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial

from ispom.methods import Config
from ispom.stop import LOOK_S, check_stop

from ...engine import warmup

Progress = Callable[[int | None], AbstractContextManager[Callable[[], None]]]
"""Takes the number of frames (None: unknown); gives a function to call after each frame."""


def wait_for_compiler() -> None:
    """Waits for numba's first compilation, and says so on standard error: how far it is on a terminal, else once."""
    if warmup.finished():
        return
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        sys.stderr.write(f"ispom: {warmup.message()}\n")
    with console.status(warmup.message()) as status:
        while not warmup.finished(LOOK_S):
            check_stop()
            status.update(warmup.message())


def compile_first(methods: Iterable[str], config: Config) -> None:
    """Compiles what these methods need before they run, and waits for it as `wait_for_compiler`."""
    warmup.start(methods, config)
    wait_for_compiler()


@contextmanager
def progress(total: int | None, quiet: bool = False) -> Iterator[Callable[[], None]]:
    """Gives a function to call after each frame; shows how far and how fast, on a terminal only, unless `quiet`.

    The function raises what ends the command, as `check_stop`.
    """
    if quiet or not sys.stderr.isatty():
        yield check_stop
        return
    from rich.console import Console  # imported here: many runs have no terminal
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]:.1f} frames/s,"),
        TimeRemainingColumn(),
    )
    with Bar(*columns, TextColumn("left"), console=Console(stderr=True)) as bar:
        task, start, count = bar.add_task("", total=total, rate=0.0), time.monotonic(), 0

        def advance() -> None:
            nonlocal count
            count += 1
            bar.update(task, advance=1, rate=count / max(time.monotonic() - start, 1e-9))
            check_stop()

        yield advance


silent: Progress = partial(progress, quiet=True)
