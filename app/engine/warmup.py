"""Numba's first compilation, in a process of its own: in this one it would hold up the page, and stall the first steps.

`start(config)` begins where machine code is still missing; `while not finished(0.05): say(message())` comes before the
first frame is computed. The app's first start of all does not wait: it shows the paper's methods meanwhile.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable

from ispom import compiled_code
from ispom.child import PYTHON, Child
from ispom.kernels import kernels
from ispom.methods import BUILT_IN, SURVEY, Config, Variant, with_dependencies

log = logging.getLogger(__name__)
MESSAGE = "compiling the estimators (first start only)"
MEANWHILE = "the modern estimators are being compiled (first start only): the paper's methods run meanwhile"
READY = "the modern estimators are compiled now: choose them under Methods"
COMMAND = [*PYTHON, "-m", "ispom.warm_up"]
COMPILED = tuple(m.name for m in (*BUILT_IN, *SURVEY) if not m.name.endswith(".paper"))
_running: list[Child] = []
"""The process: at most one."""
_failures: list[str] = []


def needed(methods: Iterable[str], config: Config) -> bool:
    """Whether these methods run compiled code of this package."""
    return any(name in COMPILED or _adjusts(name, config) for name in with_dependencies(methods))


def _adjusts(name: str, config: Config) -> bool:
    return name == "monocular.paper" and config.of(name).local_bundle


def at_first(config: Config) -> Variant:
    """The variant to open the app with: the paper's, which needs no compiling, while that goes on."""
    start(COMPILED, config)
    return "paper" if _running else "modern"


def start(methods: Iterable[str], config: Config) -> None:
    """Begins to compile, where these methods need it and it is still to be done."""
    if needed(methods, config) and not _running and not _failures and not compiled_code.is_complete():
        try:
            _running.append(Child(COMMAND))
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


def message() -> str:
    """MESSAGE, and the share that is compiled so far: a time left would depend on what else the machine does."""
    return MESSAGE if finished() else f"{MESSAGE}: {100 * _share():.0f} % done"


def _share() -> float:
    """How many of the kernels are compiled, 0..1."""
    return min(1.0, compiled_code.kept() / max(len(kernels()), 1))


def failure() -> str | None:
    """One sentence where the compilation failed, or None; the estimators then compile as they go."""
    return _failures[-1] if _failures else None


def _failed(how: str, words: str = "") -> None:
    """Once: one that failed is not tried again in this process."""
    sentence = (
        f"the estimators could not be compiled in advance ({how}): each compiles at its first use, "
        "which delays its first frames"
    )
    _failures.append(sentence)
    log.warning("\n".join(filter(None, [sentence, words])))
