"""How SIGTERM and Ctrl-C end a command that writes files: what was computed is written first, soon."""

from __future__ import annotations

import atexit
import gc
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from ispom.types import Sequence

TERMINATED = 143
PATIENCE_S = 1.0
"""After a signal a disk that does not answer is waited for so long, in all."""
REPEAT_S = 0.5
"""A signal that comes again within this time is the same one: shells and `timeout` send it to the process and to its
group."""


class Signals:
    """Those that one command has got."""

    def __init__(self) -> None:
        self._first: BaseException | None = None
        self._since_s = 0.0
        self._held = False

    def check(self) -> None:
        """Raises what the first signal stands for, where it was held, or dropped by a destructor that it came in."""
        if self._first is not None:
            raise self._first

    def hold(self) -> None:
        """From here on a first signal is raised by `check` only: files are being closed."""
        self._held = True

    def overdue(self) -> bool:
        """Whether a signal came longer ago than a disk is waited for."""
        return self._first is not None and time.monotonic() > self._since_s + PATIENCE_S

    def handle(self, number: int, _: object) -> None:
        """The handler: the first signal ends the command in good order, a second one ends the process at once."""
        if self._first is not None:
            if time.monotonic() > self._since_s + REPEAT_S:
                signal.signal(number, signal.SIG_DFL)
                signal.raise_signal(number)
            return
        self._first = SystemExit(TERMINATED) if number == signal.SIGTERM else KeyboardInterrupt()
        self._since_s = time.monotonic()
        atexit.register(gc.freeze)  # Python looks for garbage once more at its end: half a second after a run
        if not self._held:
            raise self._first


@contextmanager
def terminable() -> Iterator[Signals]:
    """SIGTERM raises SystemExit, and Ctrl-C KeyboardInterrupt, so that what was computed is written.

    Signals that are ignored, as Ctrl-C is in a shell's background jobs, stay so. Outside of the main thread whoever
    started the command there handles signals.
    """
    signals, before = Signals(), {}
    if threading.current_thread() is threading.main_thread():
        numbers = [n for n in (signal.SIGTERM, signal.SIGINT) if signal.getsignal(n) != signal.SIG_IGN]
        before = {number: signal.signal(number, signals.handle) for number in numbers}
    try:
        yield signals
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
