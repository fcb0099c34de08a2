"""Numba's first compilation, in a process of its own: in this one it would hold up the page, and stall the first steps.

start()                     # once, as early as can be; does nothing where the machine code is kept already
while not finished(0.05):   # before the first exposure is computed
    ...                     # say MESSAGE
"""

from __future__ import annotations

import subprocess
import sys
from contextlib import suppress

MESSAGE = "compiling the estimators, once after installing"
COMPILE = "from ispom.estimators.warm_up import warm_up; warm_up()"
_running: list[subprocess.Popen[bytes]] = []


def start() -> None:
    """Begins to compile, where that is still to be done."""
    from ispom.estimators.warm_up import compiled_before  # brings numba

    if not _running and not compiled_before():
        with suppress(OSError):
            nothing = subprocess.DEVNULL
            _running.append(
                subprocess.Popen([sys.executable, "-c", COMPILE], stdin=nothing, stdout=nothing, stderr=nothing)
            )


def finished(wait_s: float = 0.0) -> bool:
    """Whether no compilation is going on; waits for its end up to so long.

    Whatever became of it: what is not compiled then is compiled when it is needed.
    """
    for process in list(_running):
        try:
            process.wait(wait_s)
        except subprocess.TimeoutExpired:
            return False
        _running.remove(process)
    return True
