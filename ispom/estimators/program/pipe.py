"""A pipe to a running program: answers have bounded size and come within bounded time."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from queue import Empty, Queue
from threading import Thread
from typing import Any, BinaryIO, NoReturn

from ispom.child import PYTHON, Child

LINE_BYTES = 16 << 20
"""The longest answer."""
ENDING_S = 5.0
"""Time that a program gets to end, once it has closed its output or has been stopped."""
QUOTED = 60
"""Characters of an invalid answer that a message quotes."""
_CHUNK_BYTES, _CHUNKS = 1 << 16, 64


class ProgramFault(Exception):
    """A fault of a program; the text continues a sentence that begins with its name."""


class Pipe:
    """Used by one thread. After a ProgramFault only `stop` may be called."""

    def __init__(self, command: Sequence[str], timeout_s: float) -> None:
        """Starts the program; each answer must come within `timeout_s`."""
        supervisor = Path(__file__).with_name("supervise.py")
        self._child = Child([*PYTHON, "-E", "-S", str(supervisor), *command])
        self._timeout_s = timeout_s
        self._deadline = 0.0
        self._stopped = False
        self._read: Queue[bytes] = Queue(_CHUNKS)
        self._buffer = bytearray()
        Thread(target=_forward, args=(self._child.answers, self._read), name="program-answers", daemon=True).start()

    def request(self, request: bytes) -> dict[str, Any]:
        """Returns the answer, a JSON object. Raises ProgramFault for no answer or another one."""
        self._deadline = time.monotonic() + self._timeout_s
        with suppress(OSError):  # it has ended: reading says how
            self._child.requests.write(request)
            self._child.requests.flush()
        line = self._line()
        try:
            answer = json.loads(line, parse_constant=_refuse_constant)
        except (ValueError, RecursionError) as fault:
            raise ProgramFault(
                f"answers {_quoted(line)}, which is not JSON ({str(fault).split(':')[0][:QUOTED]})"
            ) from None
        if not isinstance(answer, dict):
            raise ProgramFault(f"answers {_quoted(line)}, which is not a JSON object")
        if isinstance(error := answer.get("error"), str):
            raise ProgramFault(f"says {error[:200]!r}")
        return answer

    def read_bytes(self, size: int) -> bytes:
        """Returns `size` bytes that follow an answer, within its time."""
        while len(self._buffer) < size:
            self._buffer += self._more()
        return self._taken(size)

    def last_line(self) -> str:
        """Returns the last line of its standard error, once it has ended."""
        lines = self._child.last_words().splitlines()
        return lines[-1].strip() if lines else ""

    def stop(self) -> None:
        """Ends the program and all that it started; further calls do nothing."""
        if self._stopped:
            return
        self._stopped = True
        with suppress(OSError):
            self._child.requests.close()
        ends = time.monotonic() + ENDING_S
        with suppress(Empty):  # later output must not block the thread that reads it
            while time.monotonic() < ends and self._read.get(timeout=ENDING_S):
                pass
        if not self._child.wait(ENDING_S):
            self._child.stop()

    def _line(self) -> bytes:
        searched = 0
        while (end := self._buffer.find(b"\n", searched)) < 0:
            searched = len(self._buffer)
            if searched > LINE_BYTES:
                raise ProgramFault(f"answers with a line of more than {LINE_BYTES >> 20} MB")
            self._buffer += self._more()
        return self._taken(end + 1)

    def _taken(self, size: int) -> bytes:
        taken = bytes(self._buffer[:size])
        del self._buffer[:size]
        return taken

    def _more(self) -> bytes:
        try:
            some = self._read.get(timeout=max(0.0, self._deadline - time.monotonic()))
        except Empty:
            raise ProgramFault(f"does not answer within {self._timeout_s:g} s") from None
        if not some:
            self._read.put(b"")
            raise ProgramFault(self._how_it_ended())
        return some

    def _how_it_ended(self) -> str:
        return self._child.ending() if self._child.wait(ENDING_S) else "closes its standard output"


def _forward(answers: BinaryIO, read: Queue[bytes]) -> None:
    """Puts all that the program writes into the queue, in pieces; an empty one when it has closed its output."""
    with answers, suppress(OSError, ValueError):
        while some := answers.read1(_CHUNK_BYTES):  # type: ignore[attr-defined]
            read.put(some)
    read.put(b"")


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")


def _quoted(line: bytes) -> str:
    text = line.decode(errors="replace").strip()
    return repr(text if len(text) <= QUOTED else f"{text[:QUOTED]}…")
