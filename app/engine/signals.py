"""How SIGTERM and Ctrl-C end a command that writes files: it first writes what it has computed.

A handler raises nothing, because it may run inside compiled code, where an exception crashes the process. It stores the
signal, and the command checks for it between two pieces of its work (`ispom.stop.check_stop`).
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
"""Longest total time after a signal for which the command waits for a disk that does not answer."""
REPEAT_S = 0.5
"""Time within which a repeated signal is the same one: shells and `timeout` send it to the process and to its group."""


class Signals:
    """The signals that one command received."""

    def __init__(self) -> None:
        self._first: BaseException | None = None
        self._since_s = -math.inf
        self._closing = self._taken = False
        self._source_stop: Callable[[], None] | None = None

    @contextmanager
    def first_ends(self, source_stop: Callable[[], None] | None) -> Iterator[None]:
        """In this context the first Ctrl-C ends the recording of a live source, and the frames so far are still
        processed. A second one ends that, too. Nothing changes where the source is not live."""
        self._source_stop = source_stop
        try:
            yield
        finally:
            self._source_stop = None

    def check(self) -> None:
        """Raises the exception of the first signal."""
        if self._source_stop is not None and self.take_interrupt():
            stop, self._source_stop = self._source_stop, None
            stop()
        if self._first is not None:
            self._taken = True
            raise self._first

    def check_unheld(self) -> None:
        """Raises the exception of the first signal, unless `hold` was called."""
        if not self._closing:
            self.check()

    def hold(self) -> None:
        """From here on only `check` raises the exception of a signal: files are being closed."""
        self._closing = True

    def overdue(self) -> bool:
        """Returns whether a signal came more than PATIENCE_S ago."""
        return self._first is not None and time.monotonic() > self._since_s + PATIENCE_S

    def take_interrupt(self) -> bool:
        """Returns whether Ctrl-C was pressed, and forgets it."""
        if not isinstance(self._first, KeyboardInterrupt) or self._taken:
            return False
        self._first = None
        return True

    @property
    def unnoticed(self) -> bool:
        """Returns whether a signal came that `check` has not raised."""
        return self._first is not None and not self._taken

    def handle(self, number: int, _: object) -> None:
        """Handles a signal: the first one ends the command in good order, a second one ends the process at once."""
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
