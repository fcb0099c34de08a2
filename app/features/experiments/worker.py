"""A worker of an experiment: a process of one thread that ends with the one that started it, or with its memory.

Its first line of standard input says in JSON where the scheduler is, with the keys to talk to it. Dask's own way to
start workers needs semaphores of the system, which not every machine grants.
"""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import signal
import sys
import threading
from typing import Any

import psutil

from ispom.child import end_with_parent

LOCAL = "127.0.0.1:0"
"""Any free port of this machine alone: Dask always listens for pages, also where there are none."""
OUT_OF_MEMORY = 77
"""Exit code."""
LOOK_S = 0.3
"""Interval between two measurements of the memory."""


def without_pages() -> None:
    """Has the nodes of Dask in this process offer no HTTP pages: every user of the machine could read them."""
    import dask.config

    dask.config.set({"distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []})


async def serve(address: str, name: str, keys: dict[str, str], scratch: str) -> None:
    """Works for the scheduler until that ends. `scratch` is a folder of the process that started this one."""
    from distributed import Worker
    from distributed.security import Security

    without_pages()
    security = Security(require_encryption=True, **keys)
    worker = Worker(
        address,
        nthreads=1,
        name=name,
        security=security,
        memory_limit=0,  # watched here: with the processes that render
        local_directory=scratch,
        host="127.0.0.1",
        dashboard=False,
        dashboard_address=LOCAL,
    )
    async with worker:
        await worker.finished()


def watch_memory(limit_bytes: float) -> None:
    """Ends this process when it and those that it started hold more."""
    own = psutil.Process()

    def watch() -> None:
        pause = threading.Event()
        while not pause.wait(LOOK_S):
            if sum(map(_resident, [own, *own.children(recursive=True)])) > limit_bytes:
                os._exit(OUT_OF_MEMORY)

    threading.Thread(target=watch, name="memory", daemon=True).start()


def _resident(process: psutil.Process) -> int:
    try:
        return process.memory_info().rss
    except psutil.Error:  # it has just ended
        return 0


def main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to all of a terminal's processes; the first one decides
    task: dict[str, Any] = json.loads(os.fdopen(os.dup(0), "rb", buffering=0).readline())
    # Where the parent was killed, nobody else removes the folder.
    end_with_parent(lambda: shutil.rmtree(task["scratch"], ignore_errors=True))
    watch_memory(1e9 * task["memory_gb"])
    sys.path[:] = task["path"]
    asyncio.run(serve(task["address"], task["name"], task["keys"], task["scratch"]))


if __name__ == "__main__":
    main()
