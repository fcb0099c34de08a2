"""Runs beside each other by Dask: on workers of this machine, or on a cluster that is there.

A task is a run, in a folder that all workers see; a worker that dies leaves an incomplete one, which the next attempt
replaces.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ispom.errors import InputError
from ispom.stop import check_stop

from .execute import execute
from .plan import Plan, Run
from .row import Row
from .workers import Workers

ATTEMPTS = 3
"""A run whose worker died so often is a row that says so."""
ANSWER_S = 20.0
"""A cluster that has not answered within this time is not there."""
LOOK_S = 0.3
"""Between two looks at whether the workers live."""
Task = Callable[[Plan, Run, Path, bool], Row]
"""As `execute`."""


def installed() -> bool:
    return all(find_spec(name) for name in ("distributed", "cryptography"))


def rows(
    plan: Plan,
    runs: Sequence[Run],
    out: Path,
    recording: bool,
    workers: int,
    memory_gb: float,
    scheduler: str | None = None,
    task: Task = execute,
) -> Generator[Row, None, None]:
    """As they are completed. InputError where the cluster does not answer."""
    if not installed():
        raise InputError("several runs at a time need Dask: pip install 'ispom[cluster]', or give --workers 0")
    from distributed import wait

    folder = out.absolute()
    with ExitStack() as stack:
        local = None if scheduler is not None else _local(stack, workers, memory_gb, ATTEMPTS * len(runs) + workers)
        client = _client(stack, scheduler) if local is None else stack.enter_context(local.cluster.get_client())
        first, waiting = _leaders(runs)
        asked: dict[Any, Run] = {}

        def submit(some: Sequence[Run]) -> None:
            asked.update({client.submit(_alone, task, plan, r, folder, recording, pure=False): r for r in some})

        submit(first)
        while asked:
            check_stop()
            if local is not None:
                local.keep()
            try:
                done: Any = wait(list(asked), timeout=LOOK_S, return_when="FIRST_COMPLETED")
            except TimeoutError:
                continue
            for future in done.done:
                run = asked.pop(future)
                # What waited for the images of this run finds them on the disk now.
                submit(waiting.pop((run.source, run.seed), []))
                yield _row(run, future, local.last_death if local is not None else "ended")


def _leaders(runs: Sequence[Run]) -> tuple[list[Run], dict[tuple[str, int], list[Run]]]:
    """Those to begin with, and those that wait: of a simulation the first run renders the images of all others."""
    first, waiting = list[Run](), dict[tuple[str, int], list[Run]]()
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


def _alone(task: Task, plan: Plan, run: Run, out: Path, recording: bool) -> Row:
    """On a worker, in one thread."""
    import cv2

    cv2.setNumThreads(1)
    return task(plan, run, out, recording)


def _row(run: Run, future: Any, last_death: str) -> Row:
    """What a task gave; where its workers died, or it could not be sent, that."""
    from distributed import KilledWorker

    fault = future.exception()
    if fault is None:
        return future.result()
    if isinstance(fault, KilledWorker):
        return Row(run, f"its worker died {ATTEMPTS} times: the last one {last_death}")
    return Row(run, f"{type(fault).__name__}: {fault}")


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
