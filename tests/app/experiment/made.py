"""Plans and rows for tests."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from urllib.request import urlopen

import psutil
from ispom_app.features.experiments.plan import Line, Plan, Run
from ispom_app.features.experiments.row import Row

LINES = (Line("a", "stereo"), Line("b", "monocular"))


def plan(**changes) -> Plan:
    given = {"name": "own", "title": "Own", "sources": ("sim:tiny",), "seeds": (0,), "lines": LINES}
    return Plan(**(given | changes))


def row(line: Line, seed: int, source: str = "sim:tiny", **values: float | None) -> Row:
    """Of a run that located all frames, where the values say nothing else."""
    return Row(Run(line, source, seed), None, {"located_percent": 100.0} | values)


def failed(line: Line, seed: int, failure: str) -> Row:
    return Row(Run(line, "sim:tiny", seed), failure)


def quick(_: Plan, run: Run, out: Path, __: bool) -> Row:
    """Stands in for `execute`."""
    return Row(run, None, {"seed": float(run.seed)})


def listening(_: Plan, run: Run, out: Path, __: bool) -> Row:
    """How many ports of the scheduler's process, and of the worker's, are open to other machines."""
    own = psutil.Process()
    opened = {"of_scheduler": own.parent(), "of_worker": own}
    return Row(run, None, {name: float(_open_to_all(process)) for name, process in opened.items() if process})


PAGES = ("/", "/status", "/health", "/metrics", "/info/main/workers.html", "/json/counts.json")


def pages(_: Plan, run: Run, out: Path, __: bool) -> Row:
    """How many of Dask's pages the ports of the scheduler's process, and of the worker's, answer."""
    own = psutil.Process()
    found = {"of_scheduler": own.parent(), "of_worker": own}
    return Row(run, None, {name: float(_answered(process)) for name, process in found.items() if process})


def _answered(process: psutil.Process) -> int:
    return sum(_is_page(port, page) for port in _listening(process) for page in PAGES)


def _is_page(port: int, page: str) -> bool:
    try:
        with urlopen(f"http://127.0.0.1:{port}{page}", timeout=5):
            return True
    except OSError:  # refused with 404, or a port that does not speak HTTP
        return False


def _listening(process: psutil.Process) -> set[int]:
    return {c.laddr.port for c in process.net_connections("tcp") if c.status == psutil.CONN_LISTEN}


def _open_to_all(process: psutil.Process) -> int:
    listening = [c.laddr for c in process.net_connections("tcp") if c.status == psutil.CONN_LISTEN]
    assert listening
    return sum(address.ip != "127.0.0.1" for address in listening)


def killed_at_first(plan: Plan, run: Run, out: Path, recording: bool) -> Row:
    """The worker dies at the first attempt of each run."""
    mark = out / f"{run.line.name}-{run.seed}"
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return quick(plan, run, out, recording)


def always_killed(plan: Plan, run: Run, out: Path, recording: bool) -> Row:
    """The worker dies at every attempt of one of the runs."""
    if run.line.name == "a":
        os.kill(os.getpid(), signal.SIGKILL)
    return quick(plan, run, out, recording)


def greedy(plan: Plan, run: Run, out: Path, recording: bool) -> Row:
    """One of the runs takes memory until it is ended."""
    held = []
    while run.line.name == "a":
        held.append(bytearray(os.urandom(1 << 20) * 64))
    return quick(plan, run, out, recording)
