"""The thread behind the page: obeys commands, works on in between, and survives what goes wrong in either."""

from __future__ import annotations

import logging
from collections.abc import Callable
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Protocol

from .commands import Command, Shutdown

log = logging.getLogger(__name__)


class Job(Protocol):
    """What a worker does. All of it is called in the worker's thread, and may raise."""

    def begin(self) -> None:
        """Once, before the first command."""
        ...

    def obey(self, command: Command) -> None: ...

    def turn(self) -> None:
        """A little of the work that goes on without commands."""
        ...

    def patience_s(self) -> float:
        """How long to wait for a command before the next turn."""
        ...

    def failed(self, fault: Exception) -> None:
        """Any of these raised this; the worker goes on."""
        ...

    def end(self) -> None:
        """Once, after `Shutdown`."""
        ...


class Worker:
    """One thread. `post` is for all others, and never waits."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self._inbox: SimpleQueue[Command] = SimpleQueue()
        self._thread = Thread(target=self._run, name="session", daemon=True)
        self._closing = False

    def start(self) -> None:
        self._thread.start()

    def post(self, command: Command) -> None:
        self._inbox.put(command)

    def close(self, timeout_s: float) -> bool:
        """Ends the thread after the commands so far; whether it ended in time."""
        self.post(Shutdown())
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        self._guarded(self._job.begin)
        while not self._closing:
            self._guarded(self._turn)
        self._guarded(self._job.end)

    def _turn(self) -> None:
        for command in newest(self._commands()):
            if isinstance(command, Shutdown):
                self._closing = True
            else:
                self._guarded(lambda command=command: self._job.obey(command))
        self._guarded(self._job.turn)

    def _commands(self) -> list[Command]:
        """All that were posted; waits for the first where there is nothing else to do."""
        found: list[Command] = []
        try:
            patience_s = self._job.patience_s()
            found.append(self._inbox.get(timeout=patience_s) if patience_s > 0 else self._inbox.get_nowait())
            while True:
                found.append(self._inbox.get_nowait())
        except Empty:
            return found

    def _guarded(self, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception as fault:
            try:
                self._job.failed(fault)
            except Exception:
                log.exception("the session worker could not report: %r", fault)


def newest(commands: list[Command]) -> list[Command]:
    """The commands without those that another of their kind follows, where only the newest one counts."""
    last = {type(command): i for i, command in enumerate(commands)}
    return [each for i, each in enumerate(commands) if not each.newest_only or last[type(each)] == i]
