"""Peak memory of this process."""

from __future__ import annotations

import sys
from pathlib import Path


def peak_mb() -> float:
    """Largest resident memory so far [MB = 2**20 bytes]; NaN where the system does not say.

    Linux counts in ru_maxrss what the parent held when it started this process, therefore VmHWM there.
    """
    if sys.platform.startswith("linux"):
        status = Path("/proc/self/status").read_text(encoding="utf-8")
        line = next((found for found in status.splitlines() if found.startswith("VmHWM:")), None)
        return int(line.split()[1]) / 1024 if line else float("nan")
    if sys.platform == "win32":
        import psutil

        return psutil.Process().memory_info().peak_wset / 2**20  # type: ignore[attr-defined]
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # bytes on macOS
