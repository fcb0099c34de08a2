"""A submission in a process of its own, as the grader sees it: requests, answers, and limits."""

from __future__ import annotations

import ctypes
import os
import pickle
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from select import select
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from ispom.child import PYTHON, Child
from ispom.errors import InputError
from ispom.stop import LOOK_S, check_stop
from ispom.types import Measurement, Rig, Step, Trajectory

from .messages import HEAD, MOST_BYTES, Answer, Listed, encoded, step_of, trajectory_of

MODULE = "ispom_app.features.grading.child"
READ_BYTES = 1 << 20
MOST_METHODS = 100
UNITS = ("metric", "own")
MOST_LETTERS = 300
"""Most letters of a sentence that comes from a submission."""
PR_GET_DUMPABLE, PR_SET_DUMPABLE = 3, 4


class Failure(Exception):
    """The submission failed; the message is the rest of a sentence that begins with "it"."""


@dataclass(frozen=True)
class Limits:
    """What one run of a submission may take."""

    seconds: float = 600.0
    """From its start to its end, with loading and compiling."""
    memory_gb: float = 4.0


class SubmissionProcess:
    """A child process that has loaded a package. Use it as a context: at its end the process and its group end."""

    def __init__(self, package: str, chosen: tuple[str, ...], limits: Limits) -> None:
        """Raises InputError where the package has no method, and Failure where its process fails."""
        self.limits, self._deadline_s = limits, time.monotonic() + limits.seconds
        self._folder = TemporaryDirectory(prefix="ispom-grade-", ignore_cleanup_errors=True)
        command = [*PYTHON, "-m", MODULE, self._folder.name, str(limits.seconds), str(limits.memory_gb)]
        self._child = Child(command)
        os.set_blocking(self._child.requests.fileno(), False)
        os.set_blocking(self._child.answers.fileno(), False)
        try:
            answer = self._asked("load", package, chosen)
            _require_kept_going(answer)
            self.methods = _listed(answer.methods)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> SubmissionProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the process, and all that it started in its group."""
        with suppress(OSError):
            os.killpg(self._child.pid, signal.SIGKILL)
        self._child.stop()
        self._folder.cleanup()

    def broken_contract(self, name: str) -> str | None:
        """Returns the first violation as a sentence; None where there is none."""
        answer = self._asked("contract", name)
        return answer.mistake or answer.failure

    def start(self, name: str, rig: Rig) -> None:
        """Builds the method. Raises InputError where the rig lacks what it needs."""
        _require_kept_going(self._asked("start", name, rig))

    def step(self, measurement: Measurement) -> list[Step]:
        """Returns the method's Steps of the measurement: none, or one of its time. Raises Failure."""
        answer = self._asked("step", measurement)
        _require_kept_going(answer)
        with _readable():
            steps = [step_of(each) for each in answer.steps or []]
        if len(steps) > 1 or any(step.time_ns != measurement.time_ns for step in steps):
            raise Failure("gives a Step of another time than its frame's")
        return steps

    def finish(self) -> Trajectory:
        """Returns the method's trajectory. Raises Failure."""
        answer = self._asked("finish")
        _require_kept_going(answer)
        if answer.trajectory is None:
            raise Failure("gives no trajectory")
        with _readable():
            return trajectory_of(answer.trajectory)

    def _asked(self, name: str, *arguments: Any) -> Answer:
        """Raises Failure where no answer comes, and InputError for a mistake of the user before the first frame."""
        self._send(encoded(pickle.dumps((name, arguments), protocol=5)))
        (length,) = HEAD.unpack(self._receive(HEAD.size))
        if length > MOST_BYTES:
            raise Failure(f"answers with {length >> 20} MB, and {MOST_BYTES >> 20} MB are the most")
        with _readable():
            answer = msgspec.msgpack.decode(self._receive(length), type=Answer)
        if not self._child.running:  # the submission ended its parent
            raise self._ended()
        if answer.mistake is not None and name in ("load", "start"):
            raise InputError(answer.mistake[:MOST_LETTERS])
        return answer

    def _send(self, content: bytes) -> None:
        view, file = memoryview(content), self._child.requests.fileno()
        while view:
            self._wait(file, writing=True)
            try:
                view = view[os.write(file, view) :]
            except BlockingIOError:
                continue
            except OSError:
                raise self._ended() from None

    def _receive(self, count: int) -> bytes:
        content, file = bytearray(), self._child.answers.fileno()
        while len(content) < count:
            self._wait(file, writing=False)
            try:
                some = os.read(file, min(count - len(content), READ_BYTES))
            except BlockingIOError:
                continue
            if not some:
                raise self._ended()
            content += some
        return bytes(content)

    def _wait(self, file: int, writing: bool) -> None:
        """Waits until the file can be read or written. Raises Failure when the time is up, or the process ended."""
        while True:
            check_stop()
            if time.monotonic() > self._deadline_s:
                raise Failure(f"takes longer than {self.limits.seconds:g} s (--seconds)")
            running = self._child.running
            ready = select([] if writing else [file], [file] if writing else [], [], LOOK_S)
            if ready[0] or ready[1]:
                return
            if not running:  # what it started may hold the pipe open
                raise self._ended()

    def _ended(self) -> Failure:
        if self._child.wait(LOOK_S):
            return Failure(f"its process {self._child.ending()}"[:MOST_LETTERS])
        return Failure("closes the connection to the grader")


@contextmanager
def hidden_memory() -> Iterator[None]:
    """Meanwhile other processes of the same user cannot read this one's memory, environment and files (Linux; root
    still can)."""
    if not sys.platform.startswith("linux"):
        yield
        return
    prctl = ctypes.CDLL(None, use_errno=True).prctl
    before = prctl(PR_GET_DUMPABLE, 0, 0, 0, 0)
    prctl(PR_SET_DUMPABLE, 0, 0, 0, 0)
    try:
        yield
    finally:
        prctl(PR_SET_DUMPABLE, before, 0, 0, 0)


def _listed(methods: list[Listed] | None) -> dict[str, Listed]:
    found = {each.name: each for each in methods or []}
    if not found or len(found) > MOST_METHODS or any(each.unit not in UNITS for each in found.values()):
        raise Failure("lists no methods that can be graded")
    return found


def _require_kept_going(answer: Answer) -> None:
    if (fault := answer.failure or answer.mistake) is not None:
        raise Failure(f"ends with {fault[:MOST_LETTERS]}")


@contextmanager
def _readable() -> Iterator[None]:
    """Raises Failure for an answer that is not as it must be."""
    try:
        yield
    except (msgspec.MsgspecError, ValueError, TypeError, OverflowError):
        raise Failure("gives an answer that cannot be read") from None
