"""A scheduler in this process, and workers of this machine that are started again when they die."""

from __future__ import annotations

import json
import logging
import os
import re
import shutil
import sys
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import Any

import psutil

from ispom.child import PYTHON, Child
from ispom.errors import InputError

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
        """Starts those anew that have died. InputError where none lives long enough to do anything."""
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
