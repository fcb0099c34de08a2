"""Runs a program while its own standard input is open, however that ends, and passes the input on.

Started by its path, with only the standard library: `python supervise.py COMMAND...`. The program writes to
the standard output and error that this process was given.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from queue import SimpleQueue

NOT_STARTED = 127
CHUNK_BYTES = 1 << 20


def supervise(command: list[str]) -> int:
    """Runs the program; returns its exit code, negative for the signal that ended it."""
    signal.signal(signal.SIGINT, lambda *_: None)  # Ctrl+C in a terminal: the parent decides what ends
    try:
        program = subprocess.Popen(command, stdin=subprocess.PIPE, bufsize=0, start_new_session=True)
    except OSError as error:
        sys.stderr.write(f"{command[0]} cannot be started: {error.strerror or error}\n")
        sys.stderr.flush()
        return NOT_STARTED
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # where the program closes its output, it is closed
    waiting: SimpleQueue[bytes] = SimpleQueue()
    for work in (_collect, _pass_on):
        threading.Thread(target=work, args=(program, waiting), daemon=True).start()
    code = program.wait()
    _end(program)
    return code


def _collect(program: subprocess.Popen[bytes], waiting: SimpleQueue[bytes]) -> None:
    """Reads whether or not the program does, so that the end of the input is noticed."""
    with contextlib.suppress(OSError):
        while some := os.read(0, CHUNK_BYTES):
            waiting.put(some)
    _end(program)


def _pass_on(program: subprocess.Popen[bytes], waiting: SimpleQueue[bytes]) -> None:
    if program.stdin is None:
        raise ValueError("the program has no pipe for its input: start it with stdin=PIPE")
    with contextlib.suppress(OSError):  # it takes no more
        while True:
            some = memoryview(waiting.get())
            while some:
                some = some[program.stdin.write(some) :]


def _end(program: subprocess.Popen[bytes]) -> None:
    """Kills the program with all that it started."""
    with contextlib.suppress(OSError):
        if hasattr(os, "killpg"):
            os.killpg(program.pid, signal.SIGKILL)
        else:
            program.kill()


if __name__ == "__main__":
    ended = supervise(sys.argv[1:])
    if ended < 0:
        signal.signal(-ended, signal.SIG_DFL) if -ended not in (signal.SIGKILL, signal.SIGSTOP) else None
        os.kill(os.getpid(), -ended)
    os._exit(ended)  # its threads wait for input
