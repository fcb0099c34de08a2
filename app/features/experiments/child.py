"""An experiment in a process of its own, for whoever started it (`app/features/sweep/process.py` reads its messages).

Its first line of standard input is the task in JSON: `plan`, the content of a plan's file; `out`, a new folder;
`workers`. It answers with lines of JSON: `{"at": [RUN, FRAMES, OF]}` while a run goes on, `{"row": RUN, ...}` when
it is over, each by its place in the plan counted from 0, and `{"problem": SENTENCE}`. The end of its standard input
ends it, with what was computed so far written.
"""

from __future__ import annotations

import json
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ispom.ensemble import build
from ispom.errors import InputError
from ispom.io.whole import write_whole

from ...engine.outputs import claim_folder
from ..headless.console import Progress
from .command import COMMAND, completed
from .options import Experiment
from .plan import Plan, Run
from .plan_file import read_plan
from .results import milliseconds
from .row import Row

PLAN = "sweep.yaml"
"""File of the plan in the folder: `ispom experiment FOLDER/sweep.yaml --out FOLDER` continues it."""
REPORT_INTERVAL_S = 0.2
"""Interval between two messages about the frames of a run."""


class ReportedRuns:
    """Sends a message for each run that is over, and for the frames of those that go on."""

    def __init__(self, plan: Plan, out: Path, send: Callable[[dict[str, Any]], None]) -> None:
        self._out, self._send = out, send
        self._places = {run: place for place, run in enumerate(plan.runs())}

    def rows(self, rows: Iterable[Row], total: int, before: int) -> Iterator[Row]:
        for row in rows:
            median_ms, _ = milliseconds(row.run, self._out / row.run.folder)
            finite = {name: v for name, v in (row.values or {}).items() if v is None or math.isfinite(v)}
            result = {"folder": row.run.folder.as_posix(), "failure": row.failure, "values": finite, "ms": median_ms}
            self._send({"row": self._places[row.run], **result})
            yield row

    def of_run(self, run: Run) -> Progress:
        @contextmanager
        def progress(total: int | None) -> Iterator[Callable[[], None]]:
            count, due_s = 0, 0.0

            def advance() -> None:
                nonlocal count, due_s
                count += 1
                if time.monotonic() >= due_s:
                    due_s = time.monotonic() + REPORT_INTERVAL_S
                    self._send({"at": [self._places[run], count, total or count]})

            yield advance

        return progress


def carry_out(task: dict[str, Any], send: Callable[[dict[str, Any]], None]) -> None:
    """InputError for what is wrong with the task. A signal ends it as it ends the command."""
    out = Path(task["out"])
    claim_folder(out, COMMAND)
    write_whole(out / PLAN, task["plan"])
    options = Experiment(plan=str(out / PLAN), out=out, workers=task["workers"])
    plan = read_plan(options)
    completed(options, plan, build, ReportedRuns(plan, out, send))


def main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to all of a terminal's processes; the first one decides
    with suppress(OSError, AttributeError):
        os.nice(5)  # where there is such a thing: the page is to stay quick
    answers = os.fdopen(os.dup(1), "w", buffering=1, encoding="utf-8")
    os.dup2(2, 1)  # what anything else prints is no answer
    requests = os.fdopen(os.dup(0), "rb", buffering=0)
    task: dict[str, Any] = json.loads(requests.readline())

    def watch() -> None:
        with suppress(OSError):
            while requests.read(4096):
                pass
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, name="end-with-parent", daemon=True).start()

    def send(message: dict[str, Any]) -> None:
        answers.write(json.dumps(message, allow_nan=False) + "\n")

    try:
        carry_out(task, send)
    except InputError as problem:
        send({"problem": str(problem)})
        sys.exit(2)


if __name__ == "__main__":
    main()
