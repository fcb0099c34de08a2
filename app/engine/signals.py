"""How SIGTERM and Ctrl-C end a command that writes files: what was computed is written first, soon.

A handler raises nothing, for it may run inside compiled code, which an exception there ends in a crash. It remembers
the signal, and the command looks between two pieces of its work (`ispom.stop.check_stop`).
"""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ispom.stop import check_stop, stopping_by

INTERRUPTED, TERMINATED = 130, 143
"""Exit codes after Ctrl-C and SIGTERM, as shells give them."""
PATIENCE_S = 1.0
"""After a signal a disk that does not answer is waited for so long, in all."""
REPEAT_S = 0.5
"""A signal that comes again within this time is the same one: shells and `timeout` send it to the process and to its
group."""


class Signals:
    """Those that one command has got."""

    def __init__(self) -> None:
        self._first: BaseException | None = None
        self._since_s = -math.inf
        self._closing = self._taken = False
        self._source_stop: Callable[[], None] | None = None

    @contextmanager
    def first_ends(self, source_stop: Callable[[], None] | None) -> Iterator[None]:
        """Meanwhile the first Ctrl-C ends the recording of a live source; what came so far is still run. A second one
        ends that. Nothing changes where the source is not live."""
        self._source_stop = source_stop
        try:
            yield
        finally:
            self._source_stop = None

    def check(self) -> None:
        """Raises what the first signal stands for."""
        if self._source_stop is not None and self.take_interrupt():
            stop, self._source_stop = self._source_stop, None
            stop()
        if self._first is not None:
            self._taken = True
            raise self._first

    def check_unheld(self) -> None:
        """The same, but nothing after `hold`."""
        if not self._closing:
            self.check()

    def hold(self) -> None:
        """From here on a first signal is raised by `check` only: files are being closed."""
        self._closing = True

    def overdue(self) -> bool:
        """Whether a signal came longer ago than a disk is waited for."""
        return self._first is not None and time.monotonic() > self._since_s + PATIENCE_S

    def take_interrupt(self) -> bool:
        """Whether Ctrl-C was pressed; once, and then it is as if it had not been."""
        if not isinstance(self._first, KeyboardInterrupt) or self._taken:
            return False
        self._first = None
        return True

    @property
    def unnoticed(self) -> bool:
        """Whether a signal came that nobody has looked for since."""
        return self._first is not None and not self._taken

    def handle(self, number: int, _: object) -> None:
        """The handler: the first signal ends the command in good order, a second one ends the process at once."""
        now_s = time.monotonic()
        if now_s <= self._since_s + REPEAT_S:
            return
        if self._first is not None:
            end_process(number)
        self._first = SystemExit(TERMINATED) if number == signal.SIGTERM else KeyboardInterrupt()
        self._since_s = now_s


def end_process(number: int, _: object = None) -> None:
    """The handler while nothing is written: the process ends at once, without a word."""
    os._exit(TERMINATED if number == signal.SIGTERM else INTERRUPTED)


@contextmanager
def terminable() -> Iterator[Signals]:
    """A signal is raised by the next `check_stop`, as SystemExit or KeyboardInterrupt, so that what was computed is
    written; one that came after the last of them, at the end.

    Signals that are ignored, as Ctrl-C is in a shell's background jobs, stay so. Outside of the main thread whoever
    started the command there handles signals.
    """
    signals = Signals()
    if threading.current_thread() is not threading.main_thread():
        yield signals
        return
    numbers = [n for n in (signal.SIGTERM, signal.SIGINT) if signal.getsignal(n) != signal.SIG_IGN]
    before = {number: signal.signal(number, signals.handle) for number in numbers}
    try:
        check_stop()  # of a command around this one: from here on its signals come here
        with stopping_by(signals.check_unheld):
            yield signals
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if signals.unnoticed:
        signals.check()
