"""Numba's first compilation, in a process of its own: in this one it would hold up the page, and stall the first steps.

`start(config)` begins where machine code is still missing; `while not finished(0.05): say(message())` comes before the
first exposure is computed. The app's first start of all does not wait: it shows the paper's methods meanwhile.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterable
from dataclasses import dataclass

from ispom.child import PYTHON, Child
from ispom.kernels import kept_share
from ispom.methods import BUILT_IN, Config, Variant, with_asked

from .pace import Pace

log = logging.getLogger(__name__)
MESSAGE = "compiling the estimators, once after installing"
MEANWHILE = "the modern estimators are being compiled, once after installing: the paper's methods run meanwhile"
READY = "the modern estimators are compiled now: choose them under Methods"
COMMAND = [*PYTHON, "-m", "ispom.warm_up"]
COMPILED = tuple(m.name for m in BUILT_IN if not m.name.endswith(".paper"))
_running: list[Child] = []
"""The process: at most one."""
_pace: list[Pace] = []
"""How far the process has been, by the monotonic clock."""
_failures: list[str] = []


@dataclass(frozen=True)
class Progress:
    """How far the compilation is."""

    share: float
    """0..1"""
    left_s: float | None
    """Estimated time until its end [s]; None while nothing is done yet."""

    @property
    def text(self) -> str:
        """For people: "20 s left", "1 % done"."""
        if self.left_s is None:
            return f"{100 * self.share:.0f} % done"
        return f"{math.ceil(self.left_s)} s left"


def needed(methods: Iterable[str], config: Config) -> bool:
    """Whether these methods run compiled code of this package."""
    return any(name in COMPILED or _adjusts(name, config) for name in with_asked(methods))


def _adjusts(name: str, config: Config) -> bool:
    return name == "monocular.paper" and config.of(name).local_bundle


def at_first(config: Config) -> Variant:
    """The variant to open the app with: the paper's, which needs no compiling, while that goes on."""
    start(COMPILED, config)
    return "paper" if _running else "modern"


def start(methods: Iterable[str], config: Config) -> None:
    """Begins to compile, where these methods need it and it is still to be done."""
    from ispom.warm_up import compiled_before

    if needed(methods, config) and not _running and not _failures and not compiled_before():
        try:
            _running.append(Child(COMMAND))
            _pace[:] = [Pace(time.monotonic())]
        except OSError as fault:
            _failed(str(fault))


def finished(wait_s: float = 0.0) -> bool:
    """Whether no compilation is going on; waits for its end up to so long.

    Whatever became of it: what is not compiled then is compiled when it is needed.
    """
    for child in list(_running):
        if not child.wait(wait_s):
            return False
        _running.remove(child)
        if not child.succeeded:
            _failed(f"the process {child.ending()}", child.last_words())
        child.stop()
    return True


def progress() -> Progress | None:
    """How far it is; None where no compilation is going on."""
    if finished() or not _running:
        return None
    share, spent_s = kept_share(), _running[0].spent_s
    if spent_s is not None:
        _pace[0] = _pace[0].after(time.monotonic(), spent_s, share)
    return Progress(share, _pace[0].left_s)


def message() -> str:
    """MESSAGE, and how long it is going to take."""
    now = progress()
    return MESSAGE if now is None else f"{MESSAGE}: {now.text}"


def failure() -> str | None:
    """One sentence where the compilation failed, or None; the estimators then compile as they go."""
    return _failures[-1] if _failures else None


def _failed(how: str, words: str = "") -> None:
    """Once: one that failed is not tried again in this process."""
    sentence = (
        f"the estimators could not be compiled in advance ({how}): each compiles at its first use, "
        "which delays its first exposures"
    )
    _failures.append(sentence)
    log.warning("\n".join(filter(None, [sentence, words])))
