"""The app and its visitors, as processes that end with the measurement."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any

import psutil

from ispom.child import PYTHON

from .served import Served


@dataclass(frozen=True, eq=False)
class App:
    """One that is served."""

    process: subprocess.Popen[str]
    address: str

    def told(self) -> dict[str, Any]:
        """What it says when a run is over; waits for that. RuntimeError where it ends instead."""
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"the app ended with code {self.process.wait()}")
        return json.loads(line)

    @property
    def memory_mb(self) -> float:
        """Of the app and the processes that it started [MB]; what they share counts once where the system tells."""
        app, held = psutil.Process(self.process.pid), 0
        for process in (app, *app.children(recursive=True)):
            memory = process.memory_full_info()
            held += getattr(memory, "pss", memory.rss)
        return held / 1e6


@contextmanager
def serving(served: Served) -> Iterator[App]:
    """The app. RuntimeError where it ends before it says where it is."""
    command = [*PYTHON, "-m", f"{__package__}.served", json.dumps(asdict(served))]
    with _ending(command, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        said = []
        for line in process.stderr:
            said.append(line)
            if found := re.search(r"ISPOM is at (\S+)", line):
                yield App(process, found[1])
                return
        raise RuntimeError(f"the app ended with code {process.wait()}: {''.join(said[-3:])}")


@contextmanager
def visitors(app: App, count: int, reads: bool) -> Iterator[subprocess.Popen[str] | None]:
    """So many pages, when all are there; None for none."""
    if not count:
        yield None
        return
    command = [*PYTHON, "-m", f"{__package__}.visitor", app.address, str(count), "reads" if reads else "idle"]
    with _ending(command) as process:
        assert process.stdout is not None
        if process.stdout.readline() != "there\n":
            raise RuntimeError(f"the visitors ended with code {process.wait()}")
        yield process


@contextmanager
def _ending(command: list[str], stderr: int | None = None) -> Iterator[subprocess.Popen[str]]:
    # As `ispom.child.Child`, but of text: it ends with this process, and no Ctrl-C of the terminal comes to it.
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=stderr, text=True, process_group=0)
    try:
        yield process
    finally:
        process.kill()
        process.wait()
