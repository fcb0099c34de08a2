"""Memory that is of no use any more goes back to the system, between parts of a run.

- Pages of libraries: what is touched of their files is mapped in pieces of 64 kB, and stays. LLVM, Arrow, Rerun and
  OpenCV touch 100 MB while they are loaded and set up, of which a run goes on to use 30. What is used again is mapped
  again from the system's cache of files, in microseconds.
- What is free, but kept for later by the C library. What one part takes and frees in small pieces, another cannot use
  where it asks in other threads or for large ones.
"""

from __future__ import annotations

import ctypes
import mmap
import re
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

LINUX = sys.platform == "linux"
_UNWRITTEN = re.compile(
    r"^([0-9a-f]+)-([0-9a-f]+) r-[-x]p .*? (/.+\.so\b.*)\n(?:[A-Z].*\n)*?Anonymous: +0 kB\n(?:[A-Z].*\n)*?Swap: +0 kB$",
    re.MULTILINE,
)
"""A library's part that is only read: its addresses, and its file. Anonymous, or swapped, is what the loader wrote
there before it took the right to away: that is not in the file."""
_libraries: list[tuple[int, int]] = []
"""Address and size [bytes] of what can be mapped again."""


def know_libraries() -> None:
    """From now on, `give_back_libraries` is about those that are loaded now; takes 10 ms.

    In the main thread, while no other loads any: what is half loaded is still to be written to. Elsewhere nothing.
    """
    if LINUX and threading.current_thread() is threading.main_thread():
        with suppress(OSError):  # some containers do not tell
            _libraries[:] = _read_only(Path("/proc/self/smaps").read_text(errors="replace"))


def give_back_libraries() -> None:
    """Takes 2 ms, and what is used again as long. Nothing but on Linux."""
    if LINUX:
        advise = ctypes.CDLL(None).madvise
        for address, size in _libraries:
            advise(ctypes.c_void_p(address), ctypes.c_size_t(size), mmap.MADV_DONTNEED)


def give_back_after(exposures: int) -> None:
    """`give_back_libraries` after 1, 2, 4, 8, ... exposures of a run: most is loaded for the first ones."""
    if exposures & (exposures - 1) == 0:
        give_back_libraries()


def give_back() -> None:
    """Pages of libraries, and what is free; takes 3 ms. Of what is free nothing but with glibc."""
    give_back_libraries()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if LINUX else None
    if trim is not None:
        trim(ctypes.c_size_t(0))


def _read_only(smaps: str) -> Iterator[tuple[int, int]]:
    """Of the libraries that Python's packages brought: those are never unloaded."""
    packages = tuple(f"{Path(folder).resolve()}/" for folder in sys.path if folder)
    for start, end, path in _UNWRITTEN.findall(smaps):
        if path.startswith(packages):
            yield int(start, 16), int(end, 16) - int(start, 16)
