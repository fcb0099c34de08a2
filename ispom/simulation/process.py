"""Rendering in a process of its own: beside it neither estimators nor the page wait for Python's lock.

Also nothing but that process has to import Open3D, and it can be started before anything else.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from functools import cache
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

if TYPE_CHECKING:
    from ispom.types import Image, Kind

_COMMAND = [sys.executable, "-m", "ispom.simulation.process"]


class RenderPool:
    """Two processes at most, of which the second is started when the first has answered and both are wanted.

    Two, not two threads: those would wait for each other's turn with Python. Safe from several threads.
    """

    def __init__(self) -> None:
        self._processes = [RenderProcess() for _ in range(min(2, os.cpu_count() or 1))]
        self._change = threading.Condition()
        self._free, self._warm = list(self._processes), False

    def start(self) -> None:
        """Begins to get the first one ready, and returns at once."""
        self._processes[0].start()

    def render(self, seed: int, motion_blur: bool, scale: float, time_ns: int, kind: Kind, threads: int) -> Image:
        """As `RenderProcess.render`, in a process that is free; waits for one."""
        with self._change:
            self._change.wait_for(lambda: self._processes[0] in self._free or (self._warm and self._free))
            process = min(self._free, key=self._processes.index)
            self._free.remove(process)
        try:
            image = process.render(seed, motion_blur, scale, time_ns, kind, threads)
            self._warm = True
            return image
        finally:
            with self._change:
                self._free.append(process)
                self._change.notify_all()

    def stop(self) -> None:
        """Ends the processes."""
        for process in self._processes:
            process.stop()


class RenderProcess:
    """Makes one image after the other. Safe from several threads; a process that died is replaced once."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._starting, self._talking = threading.Lock(), threading.Lock()

    def start(self) -> subprocess.Popen[bytes]:
        """Begins to get ready, which takes seconds, and returns at once; nothing where it runs already."""
        with self._starting:
            if self._process is None or self._process.poll() is not None:
                pipe, nowhere = subprocess.PIPE, subprocess.DEVNULL
                self._process = subprocess.Popen(_COMMAND, stdin=pipe, stdout=pipe, stderr=nowhere)
            return self._process

    def render(self, seed: int, motion_blur: bool, scale: float, time_ns: int, kind: Kind, threads: int) -> Image:
        """As `Source(seed, motion_blur, scale).render(time_ns, kind, threads)`. RuntimeError where that fails."""
        request = json.dumps([seed, motion_blur, scale, time_ns, kind, threads]).encode() + b"\n"
        with self._talking:
            with contextlib.suppress(OSError, EOFError):
                return _ask(self.start(), request)
            self.stop()
            try:
                return _ask(self.start(), request)
            except (OSError, EOFError) as fault:
                raise RuntimeError("the process that renders ended in the middle of its work") from fault

    def stop(self) -> None:
        """Ends the process."""
        with self._starting:
            process, self._process = self._process, None
        if process is None:
            return
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        process.kill()
        process.wait()


@cache
def render_pool() -> RenderPool:
    """The one of this process, which ends with it."""
    pool = RenderPool()
    atexit.register(pool.stop)
    return pool


def _ask(process: subprocess.Popen[bytes], request: bytes) -> Image:
    assert process.stdin is not None and process.stdout is not None
    process.stdin.write(request)
    process.stdin.flush()
    head = process.stdout.readline()
    if not head:
        raise EOFError
    answer = json.loads(head)
    if isinstance(answer, str):
        raise RuntimeError(f"rendering failed: {answer}")
    image = np.empty(answer, np.uint8)
    if process.stdout.readinto(image.data.cast("B")) < image.nbytes:  # type: ignore[attr-defined]
        raise EOFError
    return image


def _serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answers every line of requests with the image's shape in a line and its bytes, or with a sentence."""
    import cv2

    from ispom.simulation.noise import grain_levels
    from ispom.simulation.source import Source

    cv2.setNumThreads(1)  # the renderer has its own threads
    grain_levels()
    source: Any = None
    for line in requests:
        seed, motion_blur, scale, time_ns, kind, threads = json.loads(line)
        if source is None or source != Source(seed, motion_blur, scale):
            source = Source(seed, motion_blur, scale)
        try:
            image = source.render(time_ns, kind, threads)
        except Exception as fault:
            answers.write(json.dumps(f"{type(fault).__name__}: {fault}").encode() + b"\n")
        else:
            answers.write(json.dumps(image.shape).encode() + b"\n" + image.data.cast("B"))
        answers.flush()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to all of a terminal's processes; the first one decides
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no answer
    with contextlib.suppress(OSError):
        _serve(sys.stdin.buffer, answers)
    os._exit(0)  # Open3D's threads take their time to end
