"""The peak of this process's resident memory."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path

_PROCESS = Path("/proc/self")
_RESET = "5"
"""Written to `clear_refs`: the peak is what is resident now (proc_pid_clear_refs(5))."""


def reset_peak() -> None:
    """Begins to measure the peak again, where the system can: on Linux. Elsewhere it stays that of the process."""
    with suppress(OSError):  # some containers hide /proc, or do not let it be written to
        (_PROCESS / "clear_refs").write_text(_RESET)


def peak_mb() -> float | None:
    """Returns the peak resident memory of this process [MB = 2**20 bytes]; None where the system has no figure.

    Linux counts in ru_maxrss what the parent held when it started this process, therefore VmHWM there.
    """
    if sys.platform.startswith("linux"):
        with suppress(OSError):
            lines = (_PROCESS / "status").read_text(encoding="utf-8").splitlines()
            return next((int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM:")), None)
        return None
    if sys.platform == "win32":
        import psutil

        return psutil.Process().memory_info().peak_wset / 2**20  # type: ignore[attr-defined]
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # bytes on macOS
