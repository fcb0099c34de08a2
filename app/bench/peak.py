"""Peak memory of this process."""

from __future__ import annotations

import sys
from pathlib import Path


def peak_mb() -> float:
    """Largest resident memory so far [MB = 2**20 bytes]; NaN where the system does not tell.

    Linux counts in ru_maxrss what the parent held when it started this process, therefore VmHWM there.
    """
    if sys.platform.startswith("linux"):
        status = Path("/proc/self/status").read_text(encoding="utf-8")
        line = next((found for found in status.splitlines() if found.startswith("VmHWM:")), None)
        return int(line.split()[1]) / 1024 if line else float("nan")
    if sys.platform == "win32":
        return _windows_bytes() / 2**20
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # bytes on macOS


def _windows_bytes() -> float:
    import ctypes
    from ctypes import wintypes

    class Counters(ctypes.Structure):
        """PROCESS_MEMORY_COUNTERS of psapi.h."""

        _fields_ = [
            ("cb", wintypes.DWORD),
            ("PageFaultCount", wintypes.DWORD),
            *((f"size{i}", ctypes.c_size_t) for i in range(8)),
        ]

    kernel = ctypes.WinDLL("kernel32")  # type: ignore[attr-defined]
    kernel.GetCurrentProcess.restype = wintypes.HANDLE
    kernel.K32GetProcessMemoryInfo.argtypes = [wintypes.HANDLE, ctypes.POINTER(Counters), wintypes.DWORD]
    counters = Counters(cb=ctypes.sizeof(Counters))
    told = kernel.K32GetProcessMemoryInfo(kernel.GetCurrentProcess(), ctypes.byref(counters), counters.cb)
    return counters.size0 if told else float("nan")  # PeakWorkingSetSize
