"""Other processes that measure one thing each, with one thread."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console

from ispom.child import PYTHON

ONE_THREAD = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)
"""For numerical libraries; OpenCV is told in the process itself. The estimators compile nothing parallel."""


def found(module: str, task: dict[str, Any], one_thread: bool = True) -> Any:
    """What another process found out; {"error": ...} where it could not."""
    command = [*PYTHON, "-m", f"{__package__}.{module}", json.dumps(task)]
    environment = {**os.environ, **(ONE_THREAD if one_thread else {})}
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"it ended with code {done.returncode}"])[-1]
        return {"error": f"failed, please report it: {last}"}
    return json.loads(done.stdout.splitlines()[-1])


def told(console: Console, what: str, module: str, task: dict[str, Any]) -> list[dict[str, Any]] | None:
    """The rows that another process found; None, and said so, where it could not."""
    with progress(what):
        rows = found(module, task)
    if isinstance(rows, dict):
        console.print(f"{what}: {rows['error']}")
        return None
    return rows


@contextmanager
def progress(what: str) -> Iterator[None]:
    """Shows on a terminal what is measured."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield
        return
    with console.status(what):
        yield
