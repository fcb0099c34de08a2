"""How long work learns that it is to stop: it looks, between two pieces of the work.

The handler of a signal must raise nothing. It runs wherever the main thread happens to be, and an exception inside
compiled code that calls Python back ends the process in a crash.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

LOOK_S = 0.2
"""Between two looks while something is waited for."""
_checks: list[Callable[[], None]] = []
"""Of the commands that run, the innermost last."""


def check_stop() -> None:
    """Raises what ends the command, where something does: KeyboardInterrupt or SystemExit. For the main thread's loops,
    whose rounds take less than a second; in other threads, and in a program without such a command, it does nothing.
    """
    if _checks and threading.current_thread() is threading.main_thread():
        _checks[-1]()


@contextmanager
def stopping_by(check: Callable[[], None]) -> Iterator[None]:
    """Meanwhile `check_stop` calls `check`."""
    _checks.append(check)
    try:
        yield
    finally:
        _checks.remove(check)


def wait_or_stop(waited: Callable[[float], bool]) -> None:
    """Waits until `waited(seconds)`, which waits up to that time, returns true. Raises as `check_stop`."""
    while not waited(LOOK_S):
        check_stop()
