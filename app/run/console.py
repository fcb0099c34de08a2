"""What a command without a page shows on a terminal, and how signals end it."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from ispom.types import Sequence

from . import warmup

TERMINATED = 143


@contextmanager
def terminable() -> Iterator[Callable[[], None]]:
    """SIGTERM raises SystemExit, and Ctrl-C KeyboardInterrupt, so that what was computed is written.

    Gives a function to call now and then: it raises what a destructor, in which it first arose, has dropped.
    """
    ending: list[BaseException] = []

    def stop(number: int, _: object) -> None:
        ending.append(SystemExit(TERMINATED) if number == signal.SIGTERM else KeyboardInterrupt())
        raise ending[0]

    def check() -> None:
        if ending:
            raise ending[0]

    try:
        before = {number: signal.signal(number, stop) for number in (signal.SIGTERM, signal.SIGINT)}
    except ValueError:  # not in the main thread: whoever started it there handles signals
        yield check
        return
    try:
        yield check
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def ended_by_interrupt(sequence: Sequence) -> Iterator[None]:
    """The first Ctrl-C ends the recording of a live source; what came so far is still run. A second one ends that."""
    if sequence.stop is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    stop, before = sequence.stop, signal.getsignal(signal.SIGINT)

    def end(*_: object) -> None:
        signal.signal(signal.SIGINT, before)
        stop()

    signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def wait_for_compiler() -> None:
    """Waits for numba's first compilation, and says so on a terminal."""
    if not warmup.finished():
        with Console(stderr=True).status(warmup.message()) as status:
            while not warmup.finished(0.5):
                status.update(warmup.message())


@contextmanager
def progress(total: int | None) -> Iterator[Callable[[], None]]:
    """Gives a function to call after each exposure; shows how far and how fast, on a terminal only."""
    columns = (
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]:.1f} frames/s,"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, TextColumn("left"), console=console, disable=not console.is_terminal) as bar:
        task, start, count = bar.add_task("", total=total, rate=0.0), time.monotonic(), 0

        def advance() -> None:
            nonlocal count
            count += 1
            bar.update(task, advance=1, rate=count / max(time.monotonic() - start, 1e-9))

        yield advance
