"""Rendering in separate processes, so that neither estimators nor the page wait for Python's lock.

A process can be started before anything else, and ends with its parent.
"""

from __future__ import annotations

import atexit
import errno
import json
import os
import select
import signal
import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import cache
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from ispom.child import PYTHON, Child
from ispom.errors import InputError
from ispom.stop import wait_or_stop

if TYPE_CHECKING:
    from ispom.types import Image, Kind

_COMMAND = [*PYTHON, "-m", "ispom.simulation.rendering.process"]
IDLE_S = 60.0
"""A process without requests for this time ends, and is started again when needed: a scene and its textures take 0.36
GB, and most runs find their images on the disk."""


class RenderPool:
    """Two processes at most; the second is started when the first has answered and both are needed.

    Two threads would wait for each other's turn with Python. Safe from several threads.
    """

    def __init__(self) -> None:
        self._processes = [RenderProcess() for _ in range(min(2, os.cpu_count() or 1))]
        self._change = threading.Condition()
        self._free, self._warm = list(self._processes), False

    def start(self) -> None:
        """Starts the first process, and returns at once; a failure is raised by the first image."""
        with suppress(OSError):
            self._processes[0].start()

    def render(
        self, seed: int, motion_blur: bool, scale: float, time_ns: int, kind: Kind, threads: int, *more: str | int
    ) -> Image:
        """Calls `RenderProcess.render` in a process that is free; waits for one."""
        with self._change:
            wait_or_stop(lambda seconds: bool(self._change.wait_for(self._has_room, seconds)))
            process = min(self._free, key=self._processes.index)
            self._free.remove(process)
        try:
            image = process.render(seed, motion_blur, scale, time_ns, kind, threads, *more)
            self._warm = True
            return image
        finally:
            with self._change:
                self._free.append(process)
                self._change.notify_all()

    def _has_room(self) -> bool:
        return self._processes[0] in self._free or (self._warm and bool(self._free))

    def stop(self) -> None:
        """Ends the processes."""
        for process in self._processes:
            process.stop()

    def end(self) -> None:
        """Ends the processes for good: threads that wait for an image end soon."""
        for process in self._processes:
            process.end()


class RenderProcess:
    """Makes one image after the other. Safe from several threads; a process that died is replaced once."""

    def __init__(self, idle_s: float = IDLE_S) -> None:
        self._command = [*_COMMAND, str(idle_s)]
        self._child: Child | None = None
        self._starting, self._talking = threading.Lock(), threading.Lock()
        self._over = False

    def start(self) -> Child:
        """Begins to get ready, which takes seconds, and returns at once; nothing where it runs already.

        Raises OSError where no process can be started.
        """
        with self._starting:
            if self._over:
                raise OSError(errno.ESHUTDOWN, "the program ends")
            if self._child is None or not self._child.running:
                self._child = Child(self._command)
            return self._child

    def render(
        self, seed: int, motion_blur: bool, scale: float, time_ns: int, kind: Kind, threads: int, *more: str | int
    ) -> Image:
        """Returns `Source(seed, motion_blur, scale, *more).render(time_ns, kind, threads)`.

        Raises InputError where the process dies repeatedly; RuntimeError where rendering fails in it.
        """
        request = json.dumps([seed, motion_blur, scale, time_ns, kind, threads, *more]).encode() + b"\n"
        with self._talking:
            try:
                return self._render(request)
            except _Ended:
                pass
            try:
                return self._render(request)
            except _Ended as ended:
                raise InputError(
                    f"the process that renders the simulation {ended}, twice: "
                    "give it more memory or what it says is missing, and start again"
                ) from ended

    def _render(self, request: bytes) -> Image:
        try:
            child = self.start()
        except OSError as fault:
            raise _Ended(f"cannot be started ({fault.strerror})") from fault
        try:
            return _render_in_child(child, request)
        except (OSError, EOFError) as fault:
            child.wait(1.0)  # it closed its pipes by ending, which takes a moment
            self.stop()
            raise _Ended(child.ending()) from fault
        except (KeyboardInterrupt, SystemExit):  # the answer would be taken for that to the next request
            self.stop()
            raise

    def stop(self) -> None:
        """Ends the process."""
        with self._starting:
            child, self._child = self._child, None
        if child is not None:
            child.stop()

    def end(self) -> None:
        """Ends the process for good."""
        with self._starting:
            self._over = True
        self.stop()


class _Ended(Exception):
    """The end of the process before its answer: the text continues a sentence."""


@cache
def render_pool() -> RenderPool:
    """Returns the one of this process, which ends with it."""
    pool = RenderPool()
    atexit.register(pool.stop)
    return pool


def _render_in_child(child: Child, request: bytes) -> Image:
    """Returns the requested image. Raises OSError or EOFError where the process ended before it was complete."""
    child.requests.write(request)
    child.requests.flush()
    if hasattr(select, "poll"):  # not on Windows
        answers = select.poll()
        answers.register(child.answers, select.POLLIN)
        wait_or_stop(lambda seconds: bool(answers.poll(1000 * seconds)))
    head = child.answers.readline()
    if not head.endswith(b"\n"):
        raise EOFError
    answer = json.loads(head)
    if isinstance(answer, str):
        raise RuntimeError(f"rendering failed: {answer}")
    image = np.empty(answer, np.uint8)
    if child.answers.readinto(image.data.cast("B")) < image.nbytes:  # type: ignore[attr-defined]
        raise EOFError
    return image


def _requests(idle_s: float) -> Iterator[bytes]:
    """Yields the lines of standard input, until none has come for `idle_s`.

    The process ends with its input, also in the middle of an image: its parent has ended.
    """
    lines: SimpleQueue[bytes] = SimpleQueue()

    def read() -> None:
        with suppress(OSError):
            for line in sys.stdin.buffer:
                lines.put(line)
        os._exit(0)

    threading.Thread(target=read, name="requests", daemon=True).start()
    with suppress(Empty):
        while True:
            yield lines.get(timeout=idle_s)


def _serve(requests: Iterable[bytes], answers: BinaryIO) -> None:
    """Answers every line of requests with the image's shape in a line and its bytes, or with a sentence."""
    import cv2

    from ispom.simulation.rendering.noise import grain_levels
    from ispom.simulation.source import Source

    cv2.setNumThreads(1)  # the renderer has its own threads
    grain_levels()
    source: Any = None
    for line in requests:
        seed, motion_blur, scale, time_ns, kind, threads, *more = json.loads(line)
        if source is None or source != Source(seed, motion_blur, scale, *more):
            source = Source(seed, motion_blur, scale, *more)
        try:
            image = source.render(time_ns, kind, threads)
        except Exception as fault:
            answers.write(json.dumps(f"{type(fault).__name__}: {fault}").encode() + b"\n")
        else:
            answers.write(json.dumps(image.shape).encode() + b"\n" + image.data.cast("B"))
        answers.flush()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to all of a terminal's processes; the parent decides
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no answer
    with suppress(OSError):
        _serve(_requests(float(sys.argv[1])), answers)
    os._exit(0)
