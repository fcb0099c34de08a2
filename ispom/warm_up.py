"""A process that compiles kernels: their names come on standard input, a line each, and go back when they are there.

`python -m ispom.warm_up` ends with the process that started it. What it has compiled by then is kept by numba. With
`--gentle` it gives way to all other processes.
"""

from __future__ import annotations

import os
import sys
import threading
from queue import SimpleQueue

from ispom.kernel_list import kernel_list
from ispom.kernels import compile_kernel

GENTLE = 10
"""Of 19: what is added to the niceness of a process that is to give way to others."""


def main() -> None:
    """Compiles what is asked for, until standard input ends: at once then, for whoever asked is gone."""
    if "--gentle" in sys.argv and hasattr(os, "nice"):
        os.nice(GENTLE)
    wanted = SimpleQueue[str]()
    threading.Thread(target=_read, args=(wanted,), name="read", daemon=True).start()
    while True:
        name = wanted.get()
        compile_kernel(name, kernel_list()[name].types)
        sys.stdout.write(f"{name}\n")
        sys.stdout.flush()


def _read(wanted: SimpleQueue[str]) -> None:
    for line in sys.stdin:
        wanted.put(line.strip())
    os._exit(0)


if __name__ == "__main__":
    main()
