"""Numba's first compilation, in a process of its own: in this one it would hold up the page, and stall the first steps.

`start(config)` begins where machine code is still missing; `while not finished(0.05): say(MESSAGE)` comes before the
first exposure is computed.
"""

from __future__ import annotations

import subprocess
import sys
from contextlib import suppress

from ispom.estimators import Config

MESSAGE = "compiling the estimators, once after installing"
COMPILE = "from ispom.estimators.warm_up import warm_up; warm_up()"
_running: list[subprocess.Popen[bytes]] = []


def start(config: Config) -> None:
    """Begins to compile, where these settings need it and it is still to be done."""
    from ispom.estimators.warm_up import compiled_before

    needed = config.variant == "modern" or config.monocular.local_bundle
    if needed and not _running and not compiled_before():
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
