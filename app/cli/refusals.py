"""What `ispom` refuses to start with: files that its libraries would obey, and too small a limit of the address space,
with which they end in a segmentation fault."""

from __future__ import annotations

import os
from collections.abc import Sequence

OBEYED = {".numba_config.yaml": "numba", "matplotlibrc": "Matplotlib"}
"""Numba and Matplotlib look for these first, in whatever folder they are started. A file of aliases hangs numba, and
`text.usetex` has Matplotlib start TeX."""
NEEDED = {"help": 1.0e9, "run": 4.7e9}
"""Address space [bytes] of the libraries alone, and of a run with its recording (or a page), on Linux with two cores:
measured with `ulimit -v` on `ispom --help`, `ispom run sim:tiny` and `ispom app sim:tiny`. Most of it is reserved
only: the memory that a run really takes is a tenth."""
RUNS = {"app", "blame", "demo", "doctor", "experiment", "fork", "gate", "grade", "learn", "mcp", "run", "triage"}
"""Commands that run estimators, or serve a page. Without a word, `app` is meant."""


def obeyed_file() -> str | None:
    """One sentence where the working directory holds such a file: a stranger's folder would change what is computed.
    None where it holds none."""
    for name, library in OBEYED.items():
        if os.path.exists(name) and not os.path.isdir(name):
            return (
                f"the working directory holds {name}, which {library} would obey: start in another folder, or remove it"
            )
    return None


def too_little(words: Sequence[str]) -> str | None:
    """One sentence where this command cannot run below the limit that was set for the process; None where it can."""
    limit = _limit()
    runs = words[0] in RUNS and not {"-h", "--help"} & set(words) if words else True
    needed = NEEDED["run" if runs else "help"]
    if limit is None or limit >= needed:
        return None
    command = f"ispom {words[0]}" if runs and words else "ispom"
    return (
        f"the address space of this process is limited to {limit / 1e9:.1f} GB (ulimit -v), and {command} takes "
        f"{needed / 1e9:.1f} GB of it, mostly reserved only: raise the limit, or limit memory in another way"
    )


def _limit() -> int | None:
    """In bytes; None where there is none, and on systems without."""
    if os.name != "posix":
        return None
    import resource

    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if soft == resource.RLIM_INFINITY else soft
