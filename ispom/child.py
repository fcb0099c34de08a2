"""Child processes that never outlive this one, however it ends, and whose last words are kept.

The child holds a pipe from its parent as standard input: when that ends, so does the child, on every system, even
after SIGKILL. The child is Python, and watches it by `end_with_parent`, or by reading its requests from there.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import IO, BinaryIO

PYTHON = (sys.executable, "-P")
"""How each child is started. Without -P, `-m` and `-c` import from the working directory first: a stranger's folder."""
KEPT_BYTES = 8192
"""Of what a child writes on standard error, the end."""


class Child:
    """A running child process. Safe from several threads, but for what goes through `requests` and `answers`."""

    def __init__(self, command: list[str], environment: Mapping[str, str] | None = None) -> None:
        """Starts it with more variables in its environment. OSError where that fails."""
        pipe = subprocess.PIPE
        env = {**os.environ, **(environment or {})}
        # In a process group of its own: a terminal sends Ctrl-C to the whole group of the one that started it.
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, env=env, process_group=0)
        stdin, stdout, stderr = self._process.stdin, self._process.stdout, self._process.stderr
        if stdin is None or stdout is None or stderr is None:
            raise OSError(f"{command[0]} was started without pipes")
        self.requests: BinaryIO = stdin  # type: ignore[assignment]
        self.answers: BinaryIO = stdout  # type: ignore[assignment]
        self._error_tail = b""
        self._listener = threading.Thread(target=self._listen, args=(stderr,), name="child-stderr", daemon=True)
        self._listener.start()

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    @property
    def succeeded(self) -> bool:
        """Whether it has ended without a failure."""
        return self._process.poll() == 0

    def wait(self, wait_s: float) -> bool:
        """Returns whether the process has ended; waits up to `wait_s` for that."""
        try:
            self._process.wait(wait_s)
        except subprocess.TimeoutExpired:
            return False
        return True

    def stop(self) -> None:
        """Ends it at once, if it runs."""
        self._process.kill()
        self._process.wait()
        for file in (self.requests, self.answers):
            with suppress(OSError):
                file.close()

    def last_words(self) -> str:
        """The end of what it wrote on standard error, at most KEPT_BYTES."""
        if not self.running:
            self._listener.join(1.0)  # a grandchild may hold the pipe open
        return self._error_tail.decode(errors="replace").strip()

    def ending(self) -> str:
        """How it ended, and its last line: the rest of a sentence that begins with what it was for. Waits for that."""
        code = self._process.wait()
        with suppress(ValueError):
            if code < 0:
                return f"was ended by {signal.Signals(-code).name}{self._last_line()}"
        return f"ended with exit code {code}{self._last_line()}"

    def _last_line(self) -> str:
        lines = self.last_words().splitlines()
        return f" ({lines[-1].strip()})" if lines else ""

    def _listen(self, stderr: IO[bytes]) -> None:
        with stderr as errors:
            while some := os.read(errors.fileno(), KEPT_BYTES):
                self._error_tail = (self._error_tail + some)[-KEPT_BYTES:]


def end_with_parent(last: Callable[[], None] = lambda: None) -> None:
    """Called in a child that reads nothing from standard input: from now on it ends when its parent does, after
    `last`."""

    def watch() -> None:
        with suppress(OSError):
            while os.read(0, 4096):
                pass
        try:
            last()
        finally:
            os._exit(1)

    threading.Thread(target=watch, name="end-with-parent", daemon=True).start()
