"""The process of a submission: `python -m ispom_app.features.grading.child FOLDER SECONDS GIGABYTES`.

It receives the calibration, and images one after the other with their times: never the truth, the name or the seed of
the simulation, nor the key. Standard input and output are closed to the submission's code; what it prints goes to
standard error. A process before it waits for its end, and is all that it can find as its parent.
"""

from __future__ import annotations

import os
import resource
import signal
import sys

FILE_BYTES = 1 << 30
"""Largest file that it can write."""
CPU_SHARE = 4
"""Seconds of computing per second that it may take: it ends by itself where nobody is left to end it."""


def main(folder: str, seconds: str, gigabytes: str) -> None:
    """Forks before anything is imported: the first process passes on how the second one ended."""
    submission = os.fork()
    if submission:
        _wait_for(submission)
    os.chdir(folder)
    _limit(resource.RLIMIT_CORE, 0)
    _limit(resource.RLIMIT_FSIZE, FILE_BYTES)
    _limit(resource.RLIMIT_CPU, int(CPU_SHARE * float(seconds)) + 1)
    _limit(resource.RLIMIT_DATA, int(float(gigabytes) * 2**30))
    requests, answers = os.dup(0), os.dup(1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    from .answers import serve

    serve(requests, answers)


def _wait_for(submission: int) -> None:
    """Ends as the submission's process does."""
    os.close(0)
    os.close(1)
    status = os.waitpid(submission, 0)[1]
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        _limit(resource.RLIMIT_CORE, 0)
        if number not in (signal.SIGKILL, signal.SIGSTOP):
            signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)
    os._exit(os.waitstatus_to_exitcode(status))


def _limit(what: int, most: int) -> None:
    hard = resource.getrlimit(what)[1]
    most = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(what, (most, most))


if __name__ == "__main__":
    main(*sys.argv[1:])
