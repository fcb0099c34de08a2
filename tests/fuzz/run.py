"""Cases in worker processes, which are replaced where a case ends them or does not end."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from threading import Timer

HANG_S = 900.0
"""Without a word for so long, a worker waits for something that does not come. Cases take milliseconds."""
START_S = 900.0


def outcomes(numbers: list[int]) -> Iterator[tuple[int, str, str]]:
    """Of each case, in order: its number, what was done, and what is wrong with the outcome ("" if nothing)."""
    left = list(numbers)
    while left:
        command = [sys.executable, "-m", "tests.fuzz.worker", json.dumps(left)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2])
        begun = None
        assert process.stdout is not None
        timer = _watch(process)
        for line in process.stdout:
            timer.cancel()
            number, what, fault = json.loads(line)
            if what == "begun":
                begun = number
            else:
                begun = None
                left.remove(number)
                yield number, what, fault
            timer = _watch(process)
        timer.cancel()
        code = process.wait()
        if begun is not None:
            left.remove(begun)
            yield (
                begun,
                "see --case",
                f"the process ended with {code} (-9: waited for ever, -24: computed for too long)",
            )
        elif left:
            raise RuntimeError(f"the worker ended with {code} before its first case")


def _watch(process: subprocess.Popen[str]) -> Timer:
    timer = Timer(HANG_S, process.kill)
    timer.daemon = True
    timer.start()
    return timer
