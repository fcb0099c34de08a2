"""Memory that is free but kept for later by the C library goes back to the system, between parts of a run.

What one part takes and frees in small pieces, another cannot use where it asks in other threads or for large ones.
"""

from __future__ import annotations

import ctypes
import sys


def give_back() -> None:
    """Takes a millisecond. Nothing but with glibc."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(ctypes.c_size_t(0))
