"""Other processes that measure one thing each, with one thread."""

from __future__ import annotations

import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console

from ispom.child import PYTHON, Child
from ispom.stop import wait_or_stop

ONE_THREAD: dict[str, str] = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)
"""For numerical libraries; OpenCV's is set in the process itself. The estimators compile nothing parallel."""


END_S = 10.0
"""For a process to end after its answer."""


def found(module: str, task: dict[str, Any], one_thread: bool = True, path: Path | None = None) -> Any:
    """What `python -m MODULE TASK` prints, from JSON; {"error": ...} if it fails.

    `module` is a module's full name, and `path` a folder to import it from if it is not installed.
    """
    command = [*PYTHON, "-m", module, json.dumps(task)]
    environment = {"PYTHONPATH": str(path)} if path is not None else {}
    child = Child(command, environment | (ONE_THREAD if one_thread else {}))
    try:
        with ThreadPoolExecutor(1) as pool:
            answer = pool.submit(child.answers.read)
            try:
                wait_or_stop(lambda seconds: bool(wait([answer], seconds).done))
            except BaseException:
                child.stop()  # else the pool waits for its answer
                raise
        child.wait(END_S)
        if not child.succeeded:
            last = (child.last_words().splitlines() or [child.ending()])[-1]
            return {"error": f"failed, please report it: {last}"}
        return json.loads(answer.result().splitlines()[-1])
    finally:
        child.stop()


@contextmanager
def progress(what: str) -> Iterator[None]:
    """Shows on a terminal what is measured."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield
        return
    with console.status(what):
        yield
