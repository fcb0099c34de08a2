"""The process of a sweep: an experiment (`app/features/experiments/child.py`) that reports its progress."""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ispom.child import PYTHON, Child
from ispom.errors import InputError

COMMAND = (*PYTHON, "-m", __name__.rpartition(".sweep.")[0] + ".experiments.child")
ENDS_S = 10.0
"""When cancelled, it writes what it has; after this time it is killed."""


class SweepProcess:
    """Used by one thread."""

    def __init__(self, plan: str, out: Path, workers: int, command: Sequence[str] = COMMAND) -> None:
        """InputError where it cannot be started."""
        try:
            self._child = Child(list(command))
        except OSError as error:
            raise InputError(f"the sweep cannot be started ({error.strerror}): try again") from None
        self._messages: deque[dict[str, Any]] = deque()
        self._until_s: float | None = None
        task = {"plan": plan, "out": str(out), "workers": workers}
        with suppress(OSError):  # it has ended already, and says why
            self._child.requests.write(json.dumps(task).encode() + b"\n")
            self._child.requests.flush()
        self._listener = threading.Thread(target=self._listen, name="sweep", daemon=True)
        self._listener.start()

    def take_messages(self) -> list[dict[str, Any]]:
        """Returns the messages since the last call, oldest first."""
        found = list[dict[str, Any]]()
        with suppress(IndexError):
            while True:
                found.append(self._messages.popleft())
        return found

    @property
    def running(self) -> bool:
        """Whether more may come. One that was cancelled is killed where it does not end."""
        if self._until_s is not None and time.monotonic() > self._until_s:
            self._child.stop()
        return self._child.running or self._listener.is_alive()

    @property
    def failure(self) -> str:
        """How it ended, where that was not in good order: the rest of a sentence."""
        return "" if self._child.succeeded else self._child.ending()

    def cancel(self) -> None:
        """What it computed so far stays."""
        if self._until_s is None:
            self._until_s = time.monotonic() + ENDS_S
            with suppress(OSError):
                self._child.requests.close()

    def stop(self) -> None:
        """At once."""
        self._child.stop()

    def _listen(self) -> None:
        with suppress(OSError, ValueError):  # of a pipe that was closed meanwhile
            for line in self._child.answers:
                with suppress(ValueError):
                    self._messages.append(json.loads(line))
