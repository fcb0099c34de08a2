"""Numba's first compilation, in a process of its own: in this one it would hold up the page, and stall the first steps.

`start(config)` begins where machine code is still missing; `while not finished(0.05): say(MESSAGE)` comes before the
first exposure is computed. The app's first start of all does not wait: it shows the paper's methods meanwhile.
"""

from __future__ import annotations

import subprocess
import sys
from contextlib import suppress
from dataclasses import replace

from ispom.estimators import Config

MESSAGE = "compiling the estimators, once after installing"
MEANWHILE = "the modern estimators are being compiled, once after installing: the paper's methods run meanwhile"
READY = "the modern estimators are compiled now: choose variant modern under Methods"
COMPILE = """
import os
if hasattr(os, "nice"):
    os.nice(10)  # whoever waits for the page comes first
from ispom.estimators.warm_up import warm_up
warm_up()
"""
_running: list[subprocess.Popen[bytes]] = []


def needed(config: Config) -> bool:
    """Whether these settings run compiled code."""
    return config.variant == "modern" or config.monocular.local_bundle


def at_first(config: Config) -> Config:
    """The settings to open the app with: the paper's, which need no compiling, while that goes on."""
    start(config)
    return replace(config, variant="paper") if _running else config


def start(config: Config) -> None:
    """Begins to compile, where these settings need it and it is still to be done."""
    from ispom.estimators.warm_up import compiled_before

    if needed(config) and not _running and not compiled_before():
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
