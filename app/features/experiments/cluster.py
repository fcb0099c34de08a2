"""Parallel runs by Dask: on workers of this machine, or on a cluster that is there.

A task is a run, in a folder that all workers see; a worker that dies leaves an incomplete one, which the next attempt
replaces.
"""

from __future__ import annotations

import json
import logging
import os
import re
import shutil
import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, suppress
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import Any, Protocol, TypeVar

import psutil

from ispom.child import PYTHON, Child
from ispom.errors import InputError
from ispom.stop import check_stop

from .worker import LOCAL, OUT_OF_MEMORY, without_pages

COMMAND = [*PYTHON, "-m", __name__.rpartition(".")[0] + ".worker"]
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
SCRATCH = "ispom-worker-"
"""How the temporary folder of workers begins; the id of the process that started them comes next."""
ENVIRONMENT = {**dict.fromkeys(THREADS, "1"), "DASK_LOGGING__DISTRIBUTED": "critical"}


class Workers:
    """Talk through TLS with keys of their own: no other process can give them work, or see it."""

    def __init__(self, count: int, memory_gb: float, most_deaths: int) -> None:
        """`most_deaths`: more of them cannot come from the runs."""
        import dask.config
        from distributed import LocalCluster
        from distributed.security import Security

        remove_abandoned()
        self._scratch = TemporaryDirectory(prefix=f"{SCRATCH}{os.getpid()}-", ignore_cleanup_errors=True)
        without_pages()
        dask.config.set({"temporary-directory": self._scratch.name})
        self._security, self._memory_gb, self._left = Security.temporary(), memory_gb, most_deaths
        self.cluster: Any = LocalCluster(
            n_workers=0,
            processes=True,
            protocol="tls://",
            security=self._security,
            dashboard_address=None,  # type: ignore[arg-type]
            scheduler_kwargs={"dashboard": False, "dashboard_address": LOCAL},
            silence_logs=logging.CRITICAL,
        )
        self._children = [self._started(n) for n in range(count)]
        self.last_death = ""

    def keep(self) -> None:
        """Restarts workers that have died. Raises InputError where none lives long enough to do anything."""
        for n, child in enumerate(self._children):
            if not child.running:
                self.last_death = self._cause(child)
                child.stop()
                self._left -= 1
                if self._left < 0:
                    raise InputError(f"the workers do not live: one {self.last_death}; give --workers 0 to see more")
                self._children[n] = self._started(n)

    def close(self) -> None:
        for child in self._children:
            child.stop()
        self.cluster.close()
        self._scratch.cleanup()

    def _started(self, n: int) -> Child:
        child = Child(COMMAND, ENVIRONMENT)
        keys = {
            "tls_ca_file": self._security.tls_ca_file,
            "tls_worker_key": self._security.tls_worker_key,
            "tls_worker_cert": self._security.tls_worker_cert,
        }
        task = {"address": self.cluster.scheduler_address, "name": f"worker-{n}-{child.pid}", "keys": keys}
        task |= {"memory_gb": self._memory_gb, "path": [*filter(None, sys.path)], "scratch": self._scratch.name}
        with suppress(OSError):  # it has ended already: `keep` finds out, and says why
            child.requests.write(json.dumps(task).encode() + b"\n")
            child.requests.flush()
        return child

    def _cause(self, child: Child) -> str:
        how = child.ending()
        return f"took more than {self._memory_gb:g} GB" if f"exit code {OUT_OF_MEMORY}" in how else how


def remove_abandoned() -> None:
    """Removes the folders of workers that were killed together with the process that started them."""
    for path in Path(gettempdir()).glob(f"{SCRATCH}*"):
        found = re.fullmatch(rf"{SCRATCH}(\d+)-\w+", path.name)
        if found is not None and not psutil.pid_exists(int(found[1])):
            shutil.rmtree(path, ignore_errors=True)  # a link is left alone, and so is what another user owns


ATTEMPTS = 3
"""Number of times that the worker of a run may die; after that, the run's row says so."""
ANSWER_S = 20.0
"""A cluster that has not answered within this time is not there."""
LOOK_S = 0.3
"""Interval between two tests whether the workers live."""


class Piece(Protocol):
    """What a task is about."""

    @property
    def source(self) -> str: ...

    @property
    def seed(self) -> int: ...


P = TypeVar("P")
T = TypeVar("T", bound=Piece)
D = TypeVar("D")


def installed() -> bool:
    return all(find_spec(name) for name in ("distributed", "cryptography"))


def parallel(
    plan: P,
    runs: Sequence[T],
    out: Path,
    recording: bool,
    workers: int,
    memory_gb: float,
    scheduler: str | None,
    task: Callable[[P, T, Path, bool], D],
    failed: Callable[[T, str], D],
) -> Generator[D, None, None]:
    """What `task` gives of each, as they are completed; `failed` makes the same of one that could not be computed, and
    a sentence that says why. InputError where the cluster does not answer."""
    if not installed():
        raise InputError("several runs at a time need Dask: pip install 'ispom[cluster]', or give --workers 0")
    from distributed import wait

    folder = out.absolute()
    with ExitStack() as stack:
        local = None if scheduler is not None else _local(stack, workers, memory_gb, ATTEMPTS * len(runs) + workers)
        client = _client(stack, scheduler) if local is None else stack.enter_context(local.cluster.get_client())
        first, waiting = _leaders(runs)
        submitted: dict[Any, T] = {}

        def submit(some: Sequence[T]) -> None:
            submitted.update({client.submit(_alone, task, plan, r, folder, recording, pure=False): r for r in some})

        submit(first)
        while submitted:
            check_stop()
            if local is not None:
                local.keep()
            try:
                done: Any = wait(list(submitted), timeout=LOOK_S, return_when="FIRST_COMPLETED")
            except TimeoutError:
                continue
            for future in done.done:
                run = submitted.pop(future)
                # What waited for the images of this run finds them on the disk now.
                submit(waiting.pop((run.source, run.seed), []))
                yield _row(run, future, local.last_death if local is not None else "ended", failed)


def _leaders(runs: Sequence[T]) -> tuple[list[T], dict[tuple[str, int], list[T]]]:
    """Those to begin with, and those that wait: of a simulation the first run renders the images of all others."""
    first, waiting = list[T](), dict[tuple[str, int], list[T]]()
    for run in runs:
        key = (run.source, run.seed)
        if not run.source.startswith("sim:"):
            first.append(run)
        elif key in waiting:
            waiting[key].append(run)
        else:
            waiting[key] = []
            first.append(run)
    return first, waiting


def _alone(task: Callable[[P, T, Path, bool], D], plan: P, run: T, out: Path, recording: bool) -> D:
    """On a worker, in one thread."""
    import cv2

    cv2.setNumThreads(1)
    return task(plan, run, out, recording)


def _row(run: T, future: Any, last_death: str, failed: Callable[[T, str], D]) -> D:
    """What a task gave; where its workers died, or it could not be sent, that."""
    from distributed import KilledWorker

    fault = future.exception()
    if fault is None:
        return future.result()
    if isinstance(fault, KilledWorker):
        return failed(run, f"its worker died {ATTEMPTS} times: the last one {last_death}")
    return failed(run, f"{type(fault).__name__}: {fault}")


def _local(stack: ExitStack, count: int, memory_gb: float, most_deaths: int) -> Workers:
    import dask.config

    stack.enter_context(dask.config.set({"distributed.scheduler.allowed-failures": ATTEMPTS - 1}))
    workers = Workers(count, memory_gb, most_deaths)
    stack.callback(workers.close)
    return workers


def _client(stack: ExitStack, scheduler: str | None) -> Any:
    from distributed import Client

    try:
        return stack.enter_context(Client(scheduler, timeout=ANSWER_S))
    except (OSError, ValueError, TimeoutError) as error:
        reason = str(error).partition("\n")[0]
        raise InputError(f"--scheduler {scheduler} does not answer ({reason}): correct the address") from None
